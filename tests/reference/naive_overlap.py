# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of the search for pairs that could have been closed."""

from __future__ import annotations


def closable_pairs(hits, samples, own, num_submaps, min_num_points, min_share):
    """Return sorted pairs (submap, node).

    `hits`, `samples` hold a list of cells for each scan, `own` is a set of (submap, node).
    """
    pairs = []
    for submap in range(num_submaps):
        shown = {
            (x + dx, y + dy)
            for node in range(len(hits))
            if (submap, node) in own
            for x, y in hits[node]
            for dx in (-1, 0, 1)
            for dy in (-1, 0, 1)
        }
        for node, sample in enumerate(samples):
            if (submap, node) in own or len(sample) < max(min_num_points, 1) or not shown:
                continue
            agreeing = sum((x, y) in shown for x, y in sample)
            if agreeing / len(sample) >= min_share:
                pairs.append((submap, node))
    return pairs
