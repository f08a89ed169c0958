/* A tile of a bundle at an hour, as text: its size, the light in its middle, and the mean of its texels.
 *
 *   cargo rustc -p ndgi --release --features capi --crate-type cdylib
 *   cc -I compressor/ndgi/include compressor/ndgi/examples/decode.c -L target/release -lndgi -o decode
 *   LD_LIBRARY_PATH=target/release ./decode yard.ndgi 18.05
 */
#include "ndgi.h"
#include <stdio.h>
#include <stdlib.h>

static int fail(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, ndgi_error());
    return 1;
}

int main(int count, char **arguments)
{
    if (count != 3) {
        fprintf(stderr, "expected a bundle's path and an hour\n");
        return 2;
    }
    ndgi_bundle *bundle = ndgi_open(arguments[1]);
    if (!bundle)
        return fail("open");
    ndgi_tile_at *tile = ndgi_tile(bundle, atof(arguments[2]), NDGI_ALL, 0, 0, 0);
    ndgi_close(bundle);
    if (!tile)
        return fail("tile");

    size_t size[2];
    ndgi_tile_size(tile, size);
    size_t texels = size[0] * size[1];
    float (*light)[3] = malloc(texels * sizeof *light);
    if (!light || !ndgi_tile_decode(tile, light, texels))
        return fail("decode");

    double mean[3] = { 0 };
    for (size_t i = 0; i < texels; i++)
        for (int c = 0; c < 3; c++)
            mean[c] += light[i][c] / texels;
    float middle[3];
    ndgi_tile_sample(tile, size[0] / 2.0f, size[1] / 2.0f, middle);
    printf("%zu %zu\n%.6g %.6g %.6g\n%.6g %.6g %.6g\n", size[0], size[1], middle[0], middle[1], middle[2], mean[0], mean[1], mean[2]);

    free(light);
    ndgi_tile_free(tile);
    return 0;
}
