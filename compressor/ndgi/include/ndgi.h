/* Decodes NDGI bundles: a day of lightmaps at any place and time. See ../README.md and ../../FORMAT.md.
 *
 * Build the library:  cargo rustc -p ndgi --release --features capi --crate-type cdylib     (or staticlib)
 *
 * Light is linear Rec. 709 irradiance, red, green, blue, in the bundle's unit (kilolux), finite and not negative.
 * A bundle may be used from several threads at once, and a tile too; each is freed once, by one of them. Functions that return a pointer give NULL,
 * and those that return a bool false, where something was wrong: ndgi_error() then says what, on this thread, until the next error.
 */
#ifndef NDGI_H
#define NDGI_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct ndgi_bundle ndgi_bundle;
typedef struct ndgi_tile_at ndgi_tile_at;

/* Which light. */
enum {
    NDGI_ALL = 0,   /* all of it */
    NDGI_BAKED = 1, /* what the maps hold: without the sun's direct light, where that is a stream of its own */
    NDGI_SUN = 2    /* the sun's direct light alone, where it is a stream of its own */
};

const char *ndgi_error(void);

/* A bundle file by its path in UTF-8, or a bundle in memory, which is copied. */
ndgi_bundle *ndgi_open(const char *path);
ndgi_bundle *ndgi_open_bytes(const uint8_t *bytes, size_t length);
void ndgi_close(ndgi_bundle *bundle);

/* Width and height of a page, counted from 0. It has tiles of 126 x 126 texels; those to the right and below may be smaller. */
bool ndgi_page_size(const ndgi_bundle *bundle, size_t page, size_t size[2]);

/* A tile at an hour (decimal, any finite number; periodic in 24), made ready to be asked for texels. It does not need the bundle any more. */
ndgi_tile_at *ndgi_tile(const ndgi_bundle *bundle, double hour, int32_t lights, size_t page, size_t column, size_t row);
void ndgi_tile_free(ndgi_tile_at *tile);

/* Its width and height in texels. */
void ndgi_tile_size(const ndgi_tile_at *tile, size_t size[2]);

/* Light at (x, y) in texels, bilinear between texel centres, which are at halves; a NaN counts as 0. Takes no lock and no memory. */
void ndgi_tile_sample(const ndgi_tile_at *tile, float x, float y, float rgb[3]);

/* All texels, row by row. `count` is the number of texels that there is room for, and must be the tile's. */
bool ndgi_tile_decode(const ndgi_tile_at *tile, float (*rgb)[3], size_t count);
/* Half floats, by their bits: light times an exposure, and 1; what is above 65504 is cut. 256 suits: the shader divides by it. */
bool ndgi_tile_decode_rgba16f(const ndgi_tile_at *tile, float exposure, uint16_t (*rgba)[4], size_t count);

#ifdef __cplusplus
}
#endif

#endif
