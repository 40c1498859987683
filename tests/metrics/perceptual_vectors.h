/* SPDX-License-Identifier: Apache-2.0 */
/* Made by make_perceptual_vectors.py with PyTorch 1.13.0a0; not to be edited. */
static const struct {
    brace_perceptual_kind kind;
    uint32_t width, height, noise;
    double distance;
} vectors[] = {
    {BRACE_LPIPS_ALEX, 64, 48, 20, 0.108595319685},
    {BRACE_LPIPS_VGG, 64, 48, 20, 0.102798177608},
    {BRACE_LPIPS_SQUEEZE, 64, 48, 20, 0.149869263139},
    {BRACE_DISTS, 64, 48, 20, 0.0122809003367},
    {BRACE_LPIPS_ALEX, 83, 61, 3, 0.00238741326695},
    {BRACE_LPIPS_VGG, 83, 61, 3, 0.00281421499719},
    {BRACE_LPIPS_SQUEEZE, 83, 61, 3, 0.00512593406034},
    {BRACE_DISTS, 83, 61, 3, 0.000319918265796},
    {BRACE_LPIPS_ALEX, 32, 32, 60, 0.688153111205},
    {BRACE_LPIPS_VGG, 32, 32, 60, 0.54139907984},
    {BRACE_LPIPS_SQUEEZE, 32, 32, 60, 0.741221263007},
    {BRACE_DISTS, 32, 32, 60, 0.0631317407887},
};
