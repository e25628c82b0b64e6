"""Many trainings of the present method in a few minutes of an NVIDIA GPU, with gsplat's rasterizer in place of ours."""
