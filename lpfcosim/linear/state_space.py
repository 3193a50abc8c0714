"""Linear sampled systems with named inputs and outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class StateSpace:
    """``x[n+1] = A x[n] + B u[n]``, ``y[n] = C x[n] + D u[n]``.

    Attributes
    ----------
    A, B, C, D : ndarray, shapes (N, N), (N, U), (Y, N), (Y, U)
        Of one sample.
    inputs, outputs : tuple of str
        Names of u and y.
    dt : float
        Sample time [s].
    units : mapping of str to str
        Unit of each input and output, as Modelica spells it.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    units: Mapping[str, str] = field(default_factory=dict)

    def poles(self) -> Complex:
        """Return the eigenvalues of A, largest magnitude first."""
        z = np.linalg.eigvals(self.A).astype(np.complex128)
        return np.asarray(z[np.argsort(-np.abs(z))])

    def select(self, inputs: Sequence[str], outputs: Sequence[str]) -> StateSpace:
        """Return the system between some of its inputs and outputs."""
        columns = [self.inputs.index(name) for name in inputs]
        rows = [self.outputs.index(name) for name in outputs]
        B, C, D = self.B[:, columns], self.C[rows], self.D[np.ix_(rows, columns)]
        units = {name: self.units[name] for name in (*inputs, *outputs) if name in self.units}
        return replace(self, B=B, C=C, D=D, inputs=tuple(inputs), outputs=tuple(outputs), units=units)

    def observable(self) -> StateSpace:
        """Return the system without states that neither an output nor another state follows from."""
        states = np.arange(len(self.A))
        while True:
            A, C = self.A[np.ix_(states, states)], self.C[:, states]
            is_observable = A.any(axis=0) | C.any(axis=0)
            if is_observable.all():
                return replace(self, A=A, B=self.B[states], C=C)
            states = states[is_observable]

    def frequency_response(self, frequency: ArrayLike) -> Complex:
        """Return the response of the outputs to the inputs, shape (n, Y, U), at n frequencies [Hz]."""
        f = np.asarray(frequency, dtype=float)
        z = np.exp(2j * np.pi * self.dt * f)[:, np.newaxis, np.newaxis]
        A, B, C, D = self._elimination
        resolvent = z * np.eye(A.shape[1]) - _in_delays(A, z)
        if len(self.outputs) < len(self.inputs):
            adjoint = np.linalg.solve(resolvent.mT, _in_delays(C, z).mT)
            return np.asarray(adjoint.mT @ _in_delays(B, z) + _in_delays(D, z))
        states = np.linalg.solve(resolvent, _in_delays(B, z))
        return np.asarray(_in_delays(C, z) @ states + _in_delays(D, z))

    @cached_property
    def _elimination(self) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C, D among the states without the memory, as polynomials in 1/z.

        The memory are states, such as delayed values, that follow from others one or more samples before
        and are in no loop among themselves. With N the nilpotent block of the memory,
        (z - N)^-1 = 1/z + N/z^2 + N^2/z^3 ..., which keeps them out of every solution.
        """
        memory = self._memory
        core = np.setdiff1d(np.arange(len(self.A)), memory)
        A, B, C, D = [self.A[np.ix_(core, core)]], [self.B[core]], [self.C[:, core]], [self.D]
        N, into_memory = self.A[np.ix_(memory, memory)], self.A[np.ix_(memory, core)]
        into_core, out, driven = self.A[np.ix_(core, memory)], self.C[:, memory], self.B[memory]
        while into_memory.any() or driven.any():
            A.append(into_core @ into_memory)
            B.append(into_core @ driven)
            C.append(out @ into_memory)
            D.append(out @ driven)
            into_memory, driven = N @ into_memory, N @ driven
        return np.array(A), np.array(B), np.array(C), np.array(D)

    @cached_property
    def _memory(self) -> NDArray[np.intp]:
        """Return the numbers of states of which none follows from itself, be it through others of them."""
        memory: list[NDArray[np.intp]] = []
        candidates = np.flatnonzero(np.diag(self.A) == 0)
        while True:
            links = self.A[np.ix_(candidates, candidates)].any(axis=1)
            if links.all():
                return np.sort(np.concatenate([np.zeros(0, dtype=np.intp), *memory]))
            memory.append(candidates[~links])
            candidates = candidates[links]


def _in_delays(coefficients: Array, z: Complex) -> Complex:
    """Evaluate a polynomial in 1/z with matrix coefficients, those of the lowest order first."""
    powers = z[:, 0] ** -np.arange(len(coefficients))
    return np.asarray(np.tensordot(powers, coefficients.astype(complex), axes=1))
