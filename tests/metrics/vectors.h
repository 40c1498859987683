/* SPDX-License-Identifier: Apache-2.0 */
/* Made by make_vectors.py with scikit-image 0.19.3; not to be edited. */
static const struct {
    uint32_t width, height, channels, noise;
    double psnr, ssim;
} vectors[] = {
    {64, 48, 3, 20, 21.655548747522, 0.622068217747},
    {11, 11, 3, 50, 13.813671216586, 0.058485603284},
    {33, 17, 1, 5, 33.540320732312, 0.928538952252},
    {40, 100, 3, 90, 8.605832488948, 0.006995526273},
    {200, 150, 3, 1, 47.084832482887, 0.999594833760},
};

static const struct {
    uint32_t width, height, channels, noise;
    int scales, projections;
    uint64_t seed;
    double distance;
} swd_vectors[] = {
    {97, 85, 3, 20, 0, 0, 0u, 0.308421924008},
    {200, 150, 3, 1, 0, 0, 7u, 0.027856917720},
    {200, 150, 3, 60, 3, 10, 1099511627781u, 0.247694731482},
    {33, 17, 1, 5, 5, 6, 1u, 0.129558751427},
    {7, 5, 3, 30, 4, 16, 3u, 2.410585219161},
    {1, 1, 3, 50, 2, 8, 9u, 28.640330592641},
};
