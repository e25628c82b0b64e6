"""The feature losses against their formulas written as loops, in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from engine.training.losses import (
    clustering_loss,
    drawn_pixels,
    labelled_pixels,
    nearest_neighbours,
    neighbour_regulariser,
    paper_regulariser,
    ray_disagreement,
)

H, W, F = 12, 15, 16


def label_map(seed: int = 0) -> np.ndarray:
    """Segments 1 (large), 4, 7 and 300 (too small for min_pixels=8), and unlabelled pixels."""
    labels = np.zeros((H, W), np.int32)
    labels[:6] = 1
    labels[7:11, :7] = 4
    labels[7:12, 9:] = 7
    labels[2, 3:8] = 300
    return labels


def loop_clustering_loss(features: np.ndarray, labels: np.ndarray, min_pixels: int) -> float:
    """L_CC of segmentation.md 1.1, steps 2 to 7 without lambda, one pixel at a time."""
    f = features / (np.linalg.norm(features, axis=2, keepdims=True) + 1e-9)
    clusters = [f[labels == i] for i in np.unique(labels) if i > 0 and (labels == i).sum() > min_pixels]
    means = [cluster.mean(axis=0) for cluster in clusters]
    phi = []
    for cluster, mean in zip(clusters, means, strict=True):
        spread = sum(np.linalg.norm(pixel - mean) for pixel in cluster)
        phi.append(min(max(10 * spread / (len(cluster) * math.log(len(cluster) + 100)), 0.1), 1.0))
    total = 0.0
    for i, cluster in enumerate(clusters):
        for pixel in cluster:
            scores = [math.exp(pixel @ mean / (p + 1e-6)) for mean, p in zip(means, phi, strict=True)]
            total -= math.log(scores[i] / (sum(scores) + 1e-6))
    return total / len(clusters)


def random_features(spread: float, seed: int = 1) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.normal(size=F) + spread * rng.normal(size=(H, W, F)))


# 0.05: every phi at its floor; 0.3: between; 3: at its ceiling for small segments.
@pytest.mark.parametrize("spread", [0.05, 0.3, 3.0])
def test_clustering_loss_is_the_sum_of_the_formula(spread: float) -> None:
    features, labels = random_features(spread), label_map()
    labelled = labelled_pixels(labels, min_pixels=8)
    assert labelled is not None
    expected = loop_clustering_loss(features.numpy(), labels, 8)
    # The loop's 1e-6 beside a sum of at least exp(-1/0.1) costs 2e-8 per pixel here.
    assert clustering_loss(features, labelled).item() == pytest.approx(expected, rel=1e-6)


def test_labelled_pixels_are_those_of_the_picture_row_by_row_in_a_small_part_of_the_memory() -> None:
    labels = np.kron(label_map(), np.ones((40, 40), np.int32))
    labels[:, ::97] = 0
    labelled = labelled_pixels(labels, min_pixels=7000)
    assert labelled is not None
    every = np.flatnonzero(np.isin(labels.ravel(), (1, 4, 7, 300)))
    index, cluster = labelled.at(np.arange(len(labelled)))
    assert len(labelled) == len(every) and np.array_equal(index, every)
    assert np.array_equal(np.array([1, 4, 7, 300])[cluster], labels.ravel()[every])
    assert np.array_equal(labelled.counts.numpy(), np.bincount(cluster))
    drawn, segments, weight = drawn_pixels(labelled, 500, torch.Generator().manual_seed(5))
    numbers = torch.randint(len(every), (500,), generator=torch.Generator().manual_seed(5)).numpy()
    assert np.array_equal(drawn, index[numbers]) and np.array_equal(segments, cluster[numbers])
    assert weight == len(every) / 500
    # Numbers of pixels and segments would take 8 bytes for each pixel.
    kept = labelled.ends.nbytes + labelled.offset.nbytes + labelled.cluster.nbytes
    assert kept < 8 * len(every) / 15


def test_gradient_of_the_clustering_loss_flows_through_means_but_not_temperatures() -> None:
    features, labels = random_features(0.3).requires_grad_(), label_map()
    labelled = labelled_pixels(labels, min_pixels=8)
    assert labelled is not None
    clustering_loss(features, labelled).backward()
    f = (features / (features.norm(dim=2, keepdim=True) + 1e-9)).reshape(-1, F)
    groups = [f[torch.from_numpy(np.flatnonzero(labels == i))] for i in (1, 4, 7)]
    means = torch.stack([group.mean(dim=0) for group in groups])
    phi = torch.stack(
        [
            (10 * (g - m).norm(dim=1).mean() / math.log(len(g) + 100)).clamp(0.1, 1)
            for g, m in zip(groups, means, strict=True)
        ]
    ).detach()
    total = sum(
        torch.nn.functional.cross_entropy(g @ means.T / (phi + 1e-6), torch.full((len(g),), i), reduction="sum")
        for i, g in enumerate(groups)
    )
    (expected,) = torch.autograd.grad(total / 3, features)
    assert torch.allclose(features.grad, expected, rtol=1e-9, atol=1e-12)


def test_sampled_clustering_loss_estimates_the_whole_and_repeats() -> None:
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(1, 9, dtype=np.int32), 500).reshape(80, 50)
    features = torch.from_numpy(rng.normal(size=(8, F))[labels - 1] + rng.normal(size=(80, 50, F)))
    labelled = labelled_pixels(labels, min_pixels=8)
    assert labelled is not None
    whole = clustering_loss(features, labelled).item()
    sample = [
        clustering_loss(features, labelled, n_samples=1000, generator=torch.Generator().manual_seed(3)).item()
        for _ in range(2)
    ]
    assert sample[0] == sample[1]
    # A pixel is part of the mean it is compared with, more so in a sample: the estimate lies a little low.
    assert sample[0] == pytest.approx(whole, rel=0.15)


def test_a_picture_with_fewer_than_two_segments_has_no_clustering_loss() -> None:
    assert labelled_pixels(np.zeros((4, 4), np.int32), min_pixels=2) is None
    assert labelled_pixels(np.ones((4, 4), np.int32), min_pixels=2) is None


@pytest.mark.parametrize("n", [2, 4, 300])
def test_neighbours_are_the_nearest_other_gaussians(n: int) -> None:
    means = torch.from_numpy(np.random.default_rng(n).normal(size=(n, 3)))
    means[1] = means[0]
    found = nearest_neighbours(means, 6)
    assert found.shape == (n, 6)
    distances = torch.cdist(means, means).fill_diagonal_(torch.inf)
    for i in range(n):
        assert i not in found[i].tolist()
        nearest = distances[i].topk(min(6, n - 1), largest=False).values
        assert torch.allclose(distances[i, found[i].long()].unique(), nearest.unique())


def test_regulariser_of_true_neighbours_follows_its_formula() -> None:
    rng = np.random.default_rng(0)
    # Two clusters 10 apart: whatever is far from an anchor is in the other cluster, where all features are one vector.
    means = torch.from_numpy(np.repeat([[0.0, 0, 0], [10, 0, 0]], 20, axis=0) + rng.normal(size=(40, 3)) * 0.1)
    features = torch.from_numpy(np.repeat(rng.normal(size=(2, F)), 20, axis=0))
    cosine = torch.nn.functional.cosine_similarity(features[0], features[20], dim=0).item()
    loss = neighbour_regulariser(
        features,
        means,
        nearest_neighbours(means),
        far=5.0,
        generator=torch.Generator().manual_seed(0),
    )
    sigmoid = lambda x: 1 / (1 + math.exp(-x))  # noqa: E731
    assert loss.item() == pytest.approx(0.05 * sigmoid(0.0) + 0.15 * sigmoid(cosine), rel=1e-6)


def test_published_regulariser_follows_its_formula() -> None:
    rng = np.random.default_rng(5)
    means, features = torch.from_numpy(rng.normal(size=(50, 3))), torch.from_numpy(rng.normal(size=(50, F)))
    near, far = [], []
    for i in range(50):
        order = np.argsort(np.linalg.norm(means.numpy() - means[i].numpy(), axis=1))
        cosines = torch.nn.functional.cosine_similarity(features[i][None], features, dim=1).numpy()
        near += list(cosines[order[:2]])
        far += list(cosines[order[-5:]])
    loss = paper_regulariser(features, means, generator=torch.Generator().manual_seed(0))
    expected = 0.05 / (1 + math.exp(-(1 - np.mean(near)))) + 0.15 / (1 + math.exp(-np.mean(far)))
    assert loss.item() == pytest.approx(expected, rel=1e-9)


def test_ray_disagreement_is_zero_where_all_features_are_equal() -> None:
    rng = np.random.default_rng(2)
    weights = torch.from_numpy(rng.dirichlet(np.ones(6), size=(3, 4))[..., :5])
    unit = torch.nn.functional.normalize(torch.from_numpy(rng.normal(size=(5, F))), dim=1)
    transmittance = 1 - weights.sum(dim=2)
    same = ray_disagreement(weights @ unit[:1].expand(5, F), transmittance)
    assert abs(same.item()) < 1e-12
    expected = torch.einsum("hwi,hwj,ij->hw", weights, weights, 1 - unit @ unit.T).mean()
    assert ray_disagreement(weights @ unit, transmittance).item() == pytest.approx(expected.item(), rel=1e-9)
