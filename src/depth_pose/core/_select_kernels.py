"""Selection by value. NumPy's own, `np.partition`, takes five seconds to compile, for its error messages."""

from __future__ import annotations

from depth_pose.core.kernels import njit


@njit(cache=True)
def kth_smallest(values, k):
    """Return element ``k`` of sorted values (N,), none of them NaN; by Hoare's selection."""
    kept = values.copy()
    low, high = 0, kept.shape[0] - 1
    while low < high:
        pivot, i, j = kept[(low + high) // 2], low, high
        while i <= j:
            while kept[i] < pivot:
                i += 1
            while kept[j] > pivot:
                j -= 1
            if i <= j:
                kept[i], kept[j] = kept[j], kept[i]
                i, j = i + 1, j - 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return kept[k]
