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
