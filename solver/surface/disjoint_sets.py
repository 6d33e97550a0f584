"""Disjoint sets of the numbers 0 … n − 1 (union-find), which the smallest number of each set leads.

An array ``leader`` (n,) of integers has a member of the same set for each number, at most as large. It begins as
``np.arange(n)``: each number is a set of its own.
"""

from puppetline.compiled import compiled


@compiled
def join(leader, a, b):
    """Join the sets of a and b; ``leader`` is written to."""
    first, second = _find(leader, a), _find(leader, b)
    leader[max(first, second)] = min(first, second)


@compiled
def number_sets(leader):
    """Replace each entry of ``leader``, in place, by the number of its set, in the order of their smallest members."""
    count = 0
    for item in range(len(leader)):
        if leader[item] == item:
            leader[item] = count
            count += 1
        else:
            leader[item] = leader[leader[item]]  # an earlier entry, which is the number of the set already


@compiled
def _find(leader, item):
    """Return the leader of a set, and shorten the way to it."""
    while leader[item] != item:
        leader[item] = leader[leader[item]]
        item = leader[item]
    return item
