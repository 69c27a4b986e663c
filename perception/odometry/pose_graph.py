"""Pose graph: key frames and motions between them, adjusted together by sparse elimination."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, adjoints, inverse, logarithms, motion, motions


@dataclass(slots=True)
class BlockSystem:
    """A positive definite system: diagonal blocks, blocks beside them, and the right side."""

    diagonal: Floats  # (n, 6, 6)
    right: Floats  # (n, 6)
    beside: list[dict[int, Floats]]  # row -> column -> (6, 6), both (i, j) and (j, i)

    @classmethod
    def of(
        cls,
        diagonal: Floats,
        right: Floats,
        rows: NDArray[np.intp],
        columns: NDArray[np.intp],
        blocks: Floats,
    ) -> BlockSystem:
        """The system with blocks (m, 6, 6) at rows and columns (m,), and their transposes."""
        beside: list[dict[int, Floats]] = [{} for _ in diagonal]
        for i, j, block in zip(rows.tolist(), columns.tolist(), blocks, strict=True):
            beside[i][j] = beside[i][j] + block if j in beside[i] else block
            beside[j][i] = beside[j][i] + block.T if i in beside[j] else block.T
        return cls(diagonal.copy(), right.copy(), beside)

    def solved(self) -> Floats:
        """The solution (n, 6); the system is used up."""
        left = [(len(beside), row) for row, beside in enumerate(self.beside)]
        heapq.heapify(left)
        order = list[tuple[int, list[int], Floats]]()
        done = np.zeros(len(left), bool)
        while left:
            degree, row = heapq.heappop(left)
            if done[row] or degree != len(self.beside[row]):
                continue  # its degree has changed since
            done[row] = True
            order.append((row, *self._eliminated(row)))
            for other in order[-1][1]:
                heapq.heappush(left, (len(self.beside[other]), other))
        found = np.zeros_like(self.right)
        for row, near, factor in reversed(order):
            found[row] = self.right[row]
            if near:
                found[row] -= factor @ found[near].ravel()
        return found

    def _eliminated(self, row: int) -> tuple[list[int], Floats]:
        """Eliminate `row` from the others; its unknown is right - factor @ unknowns of the rows."""
        near = list(self.beside[row])
        if not near:
            self.right[row] = np.linalg.solve(self.diagonal[row], self.right[row])
            return near, np.zeros((6, 0))
        across = np.hstack([self.beside[row][i] for i in near])  # (6, 6 m)
        solved = np.linalg.solve(self.diagonal[row], np.hstack([across, self.right[row][:, None]]))
        factor, self.right[row] = solved[:, :-1], solved[:, -1]
        update = (across.T @ factor).reshape(len(near), 6, len(near), 6)
        self.right[near] -= (across.T @ self.right[row]).reshape(-1, 6)
        for a, i in enumerate(near):
            self.diagonal[i] -= update[a, :, a]
            row_of = self.beside[i]
            del row_of[row]
            for b, j in enumerate(near):
                if i != j:
                    block = update[a, :, b]
                    row_of[j] = row_of[j] - block if j in row_of else -block
        return near, factor


Floats = NDArray[np.float64]

ITERATIONS: Final = 20
_OUTLIER: Final = 25.0  # squared error of a motion, in units of its variance, that counts a quarter
_GRADES: Final = 5  # iterations in which wrong edges come to count less
_MANY: Final = 0.1  # share of all edges
_OFF: Final = 0.03  # [m] between where poses and an edge put a camera
_CONVERGED: Final = 1e-4  # [m, rad] largest step
_ANCHOR: Final = 1e-4  # share of the mean information that holds each pose where it is


@dataclass(frozen=True, slots=True)
class PoseConstraint:
    """A measured motion: `T` takes points of key frame `first` to key frame `second`."""

    first: int
    second: int
    T: Pose
    information: Floats  # (6, 6) of a small motion (rotation, translation) after T


def adjusted(
    poses: Sequence[Pose], edges: Sequence[PoseConstraint], iterations: int = ITERATIONS
) -> Floats:
    """Poses (n, 4, 4), camera to world, that fit the edges best; the first pose stays.

    Gauss-Newton with the weights of Geman and McClure, by which wrong edges lose their influence;
    at first nearly all count in full, so that a long way is closed by its loops (graduated
    non-convexity: Yang et al., IEEE RA-L 5, 2020).
    """
    found = np.array(poses, np.float64)
    if len(found) < 2 or not edges:
        return found
    first = np.array([edge.first for edge in edges])
    second = np.array([edge.second for edge in edges])
    back = np.linalg.inv([edge.T for edge in edges])
    information = np.array([edge.information for edge in edges])
    for iteration in range(iterations):
        outlier = _OUTLIER * 4.0 ** max(_GRADES - iteration, 0)
        predicted = np.linalg.inv(found[second]) @ found[first]
        error = logarithms(predicted @ back)
        W = _weights(error, information, outlier)[:, None, None] * information
        A = adjoints(predicted)
        system = _system(len(found), first, second, A, W, error)
        step = system.solved()
        step[0] = 0.0
        # a step moves the points of the camera before its pose takes them to the world
        found = found @ motions(step)
        if iteration >= _GRADES and np.abs(step).max() < _CONVERGED:
            break
    return found


def needs_adjustment(
    poses: Sequence[Pose], edges: Sequence[PoseConstraint], adjusted_edges: int
) -> bool:
    """Whether edges after the first `adjusted_edges` are many, or contradict the poses."""
    new = edges[adjusted_edges:]
    if len(new) > _MANY * len(edges):
        return True
    return any(motion(poses[e.second], poses[e.first] @ inverse(e.T))[0] > _OFF for e in new)


def _weights(error: Floats, information: Floats, outlier: float) -> Floats:
    squared = np.einsum("ni,nij,nj->n", error, information, error)
    weights: Floats = (outlier / (outlier + squared)) ** 2
    return weights


def _system(
    count: int,
    first: NDArray[np.intp],
    second: NDArray[np.intp],
    A: Floats,
    W: Floats,
    error: Floats,
) -> BlockSystem:
    """Normal equations of all poses; the first is held where it is."""
    At = A.transpose(0, 2, 1)
    diagonal, right = np.zeros((count, 6, 6)), np.zeros((count, 6))
    np.add.at(diagonal, first, At @ W @ A)
    np.add.at(diagonal, second, W)
    We = np.einsum("nij,nj->ni", W, error)
    np.add.at(right, first, -np.einsum("nij,nj->ni", At, We))
    np.add.at(right, second, We)
    held = _ANCHOR * np.einsum("nii->ni", diagonal).mean(axis=0)
    diagonal += np.diag(held)
    diagonal[0] += np.diag(held) * 1e8
    return BlockSystem.of(diagonal, right, first, second, -At @ W)
