"""Aggregates of elements that are joined by conductances, and the graph of the aggregates.

Conductances span decades, also between neighbours. An aggregate must not join waters on both sides of a closed place.
Elements of a block of 2 × 2 belong to one aggregate if a chain of strong joints connects them. A joint is strong if its
conductance is at least `STRONG` times the largest conductance at either end. An element without a strong joint in its
block takes its best joint, if that joint is strong for this element. Aggregates are joined by the sum of the
conductances between their elements times `STRETCHED`, because the way between the centres is longer. They lie in blocks
of twice the size, and so on. Aggregation after Notay, Electronic Transactions on Numerical Analysis 37 (2010) 123-146;
the scaled coarse matrix after Braess, Computing 55 (1995) 379-393.

Elements of a grid that do not conduct have the number -1. Joints of the last line of a grid lead to the first. Indices
of a graph are unsigned: compiled code then does not ask whether they count from the end.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from roughvol.gap.compiled import compiled
from roughvol.typing import Array

STRONG, STRETCHED = 0.25, 0.7
Numbers = NDArray[np.int32]
Indices = NDArray[np.uint32]


class Graph(NamedTuple):
    """Aggregates, the row and column of their blocks, their joints, and conductances to pressures held (own).

    A joint is listed once, with the aggregates at its ends (tails and heads) and its conductance (weight).
    """

    tails: Indices
    heads: Indices
    weight: Array
    own: Array
    row: Indices
    column: Indices


@compiled
def of_grid(south: Array, east: Array, own: Array) -> tuple[Numbers, int]:
    """Return the aggregate of each element, shape (rows, columns), and how many there are."""
    rows, columns = own.shape
    number, count = np.empty((rows, columns), np.int32), 0
    for i in range(0, rows, 2):
        high = i + 1 < rows
        for j in range(0, columns, 2):
            wide = j + 1 < columns
            # the elements a b, and c d below them
            a = _largest(south, east, own, i, j)
            b = _largest(south, east, own, i, j + 1) if wide else 0.0
            c = _largest(south, east, own, i + 1, j) if high else 0.0
            d = _largest(south, east, own, i + 1, j + 1) if high and wide else 0.0
            ab, ac = east[i, j] if wide else 0.0, south[i, j] if high else 0.0
            cd, bd = (east[i + 1, j], south[i, j + 1]) if high and wide else (0.0, 0.0)
            join_ab, join_cd = _strong(ab, max(a, b)), _strong(cd, max(c, d))
            join_ac, join_bd = _strong(ac, max(a, c)), _strong(bd, max(b, d))
            lone_a, lone_b = not (join_ab or join_ac), not (join_ab or join_bd)
            lone_c, lone_d = not (join_cd or join_ac), not (join_cd or join_bd)
            # of equal joints the first alone: two might lead into two waters
            join_ac |= (lone_a and ac >= ab and _strong(ac, a)) or (lone_c and ac >= cd and _strong(ac, c))
            join_bd |= (lone_b and bd >= ab and _strong(bd, b)) or (lone_d and bd >= cd and _strong(bd, d))
            join_ab |= (lone_a and ab > ac and _strong(ab, a)) or (lone_b and ab > bd and _strong(ab, b))
            join_cd |= (lone_c and cd > ac and _strong(cd, c)) or (lone_d and cd > bd and _strong(cd, d))
            of_a, count = _numbered(a, count)
            of_b, count = (of_a, count) if join_ab or (join_ac and join_cd and join_bd) else _numbered(b, count)
            if join_ac or (join_ab and join_bd and join_cd):
                of_c = of_a
            elif join_bd and join_cd:
                of_c = of_b
            else:
                of_c, count = _numbered(c, count)
            if join_bd or join_cd:
                of_d = of_b if join_bd else of_c
            else:
                of_d, count = _numbered(d, count)
            number[i, j] = of_a
            if wide:
                number[i, j + 1] = of_b
            if high:
                number[i + 1, j] = of_c
            if high and wide:
                number[i + 1, j + 1] = of_d
    return number, count


@compiled
def _largest(south: Array, east: Array, own: Array, i: int, j: int) -> float:
    """Return the largest conductance at an element of a grid."""
    before, behind = south[i - 1 if i else own.shape[0] - 1, j], east[i, j - 1 if j else own.shape[1] - 1]
    return max(max(own[i, j], max(south[i, j], east[i, j])), max(before, behind))


@compiled
def _numbered(largest: float, count: int) -> tuple[int, int]:
    """Return the number of a new aggregate of an element, -1 if it does not conduct, and how many there are then."""
    return (count, count + 1) if largest > 0.0 else (-1, count)


@compiled
def _strong(joint: float, largest: float) -> bool:
    return joint > 0.0 and joint >= STRONG * largest


@compiled
def graph_of_grid(south: Array, east: Array, own: Array, number: Numbers, count: int) -> Graph:
    """Return the graph of the aggregates of a grid."""
    rows, columns = own.shape
    held, row, column = np.zeros(count), np.empty(count, np.uint32), np.empty(count, np.uint32)
    size = 2 * own.size  # at most; most joints are inside aggregates, or beside another joint of the same two
    tails, heads, weight, end = np.empty(size, np.uint32), np.empty(size, np.uint32), np.empty(size), 0
    for top in range(0, rows, 2):
        for left in range(0, columns, 2):
            first = end
            for i in range(top, min(top + 2, rows)):
                for j in range(left, min(left + 2, columns)):
                    tail = number[i, j]
                    if tail < 0:
                        continue
                    held[tail] += STRETCHED * own[i, j]
                    row[tail], column[tail] = top // 2, left // 2
                    for axis in range(2):
                        if axis == 0:
                            head, joint = number[i + 1 if i + 1 < rows else 0, j], south[i, j]
                        else:
                            head, joint = number[i, j + 1 if j + 1 < columns else 0], east[i, j]
                        if head == tail or joint == 0.0:
                            continue
                        at = first
                        while at < end and (tails[at] != tail or heads[at] != head):
                            at += 1
                        if at == end:
                            tails[end], heads[end], weight[end], end = tail, head, 0.0, end + 1
                        weight[at] += STRETCHED * joint
    return Graph(tails[:end], heads[:end], weight[:end], held, row, column)


@compiled
def of_graph(graph: Graph) -> tuple[Indices, int]:
    """Return the aggregate of each node of a graph in its block of twice the size, and how many there are."""
    tails, heads, weight, own, row, column = graph
    largest = own.copy()
    for k in range(tails.size):
        largest[tails[k]] = max(largest[tails[k]], weight[k])
        largest[heads[k]] = max(largest[heads[k]], weight[k])
    chain = np.arange(own.size).astype(np.uint32)
    best, to, alone = np.zeros(own.size), chain.copy(), np.ones(own.size, np.bool_)
    for k in range(tails.size):
        tail, head, joint = tails[k], heads[k], weight[k]
        if row[head] >> 1 != row[tail] >> 1 or column[head] >> 1 != column[tail] >> 1:
            continue
        if joint >= STRONG * max(largest[tail], largest[head]):
            alone[tail] = alone[head] = False
            _join(chain, tail, head)
        for node, other in ((tail, head), (head, tail)):
            if joint >= STRONG * largest[node] and joint > best[node]:
                best[node], to[node] = joint, other
    for node in range(own.size):
        if alone[node]:
            _join(chain, node, to[node])
    number, count = np.empty(own.size, np.uint32), 0
    for node in range(own.size):
        if chain[node] == node:
            number[node] = count
            count += 1
        else:
            number[node] = number[_root(chain, node)]
    return number, count


@compiled
def _root(chain: Indices, node: int) -> int:
    """Return the first node of a chain, and shorten the chain on the way."""
    while chain[node] != node:
        chain[node] = chain[chain[node]]
        node = chain[node]
    return node


@compiled
def _join(chain: Indices, one: int, other: int) -> None:
    """Join the chains of two nodes under the smaller number."""
    one, other = _root(chain, one), _root(chain, other)
    chain[max(one, other)] = min(one, other)


@compiled
def graph_of_graph(graph: Graph, number: Indices, count: int) -> Graph:
    """Return the graph of the aggregates of a graph."""
    tails, heads, weight, own, row, column = graph
    held, rows, columns = np.zeros(count), np.empty(count, np.uint32), np.empty(count, np.uint32)
    for node in range(own.size):
        here = number[node]
        held[here] += STRETCHED * own[node]
        rows[here], columns[here] = row[node] // 2, column[node] // 2
    starts = np.zeros(count + 1, np.uint32)
    for k in range(tails.size):
        starts[min(number[tails[k]], number[heads[k]]) + 1] += 1
    for node in range(count):
        starts[node + 1] += starts[node]
    order, place = np.empty(tails.size, np.uint32), starts.copy()
    for k in range(tails.size):
        tail = min(number[tails[k]], number[heads[k]])
        order[place[tail]] = k
        place[tail] += 1
    # joints between the same two aggregates are added up
    size = tails.size
    tail, head, joint, end = np.empty(size, np.uint32), np.empty(size, np.uint32), np.empty(size), 0
    found = np.full(count, -1, np.int32)
    for node in range(count):
        first = end
        for at in range(starts[node], starts[node + 1]):
            k = order[at]
            other = max(number[tails[k]], number[heads[k]])
            if other == node:
                continue
            if found[other] < first:
                found[other] = end
                tail[end], head[end], joint[end], end = node, other, 0.0, end + 1
            joint[found[other]] += STRETCHED * weight[k]
    return Graph(tail[:end], head[:end], joint[:end], held, rows, columns)
