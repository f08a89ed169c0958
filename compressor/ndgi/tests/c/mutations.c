/* Bundles from stdin, one after another, each behind its length: opens each, decodes all its tiles at noon. Prints how many were opened, how many
 * tiles decoded and how many refused. */
#include "ndgi.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static unsigned long opened, decoded, refused;

static int decode(const ndgi_bundle *bundle)
{
    for (size_t page = 0; page < 4; page++) {
        size_t size[2];
        if (!ndgi_page_size(bundle, page, size) || size[0] > 4096 || size[1] > 4096)
            continue;
        for (size_t row = 0; row * 126 < size[1]; row++) {
            for (size_t column = 0; column * 126 < size[0]; column++) {
                ndgi_tile_at *tile = ndgi_tile(bundle, 12.3, NDGI_ALL, page, column, row);
                if (!tile) {
                    refused++;
                    continue;
                }
                float rgb[3];
                ndgi_tile_sample(tile, 1.5f, 1.5f, rgb);
                ndgi_tile_free(tile);
                if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2]))
                    return 1;
                decoded++;
            }
        }
    }
    return 0;
}

int main(void)
{
    uint8_t length[4];
    while (fread(length, 1, 4, stdin) == 4) {
        size_t count = length[0] | length[1] << 8 | length[2] << 16 | (size_t)length[3] << 24;
        uint8_t *bytes = malloc(count + 1);
        if (!bytes || fread(bytes, 1, count, stdin) != count)
            return 2;
        ndgi_bundle *bundle = ndgi_open_bytes(bytes, count);
        free(bytes);
        if (bundle) {
            opened++;
            if (decode(bundle))
                return 1;
        } else {
            refused++;
        }
        ndgi_close(bundle);
    }
    printf("%lu %lu %lu\n", opened, decoded, refused);
    return 0;
}
