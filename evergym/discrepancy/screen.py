"""Screen the candidates by their signatures: what switching an effect on changes that no recalibration can absorb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evergym.discrepancy.candidates import FREQUENCY_END, ROUNDING_FINE, Candidate, with_frequencies
from evergym.discrepancy.fit import Fit, solve_normal
from evergym.discrepancy.periodogram import find_frequencies
from evergym.discrepancy.predict import Predictor
from evergym.discrepancy.space import Space

__all__ = [
    "Projector",
    "Screening",
    "Signature",
    "Strength",
    "group_equivalent",
    "rank_candidates",
    "screen_candidates",
    "search_strengths",
    "simulate_changes",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRETCH = (0.2, 4.0)
"""A signature taken at one strength stands for strengths between these multiples of it."""
SEARCH = ((0.4, 1.0, 2.5), (0.65, 1.5))
"""Multiples of the strength that are tried before a fit, round by round."""
NEAR_SHARE = 0.6
"""A strength that was stretched to less than this share of the one simulated is not near to it."""
HOPELESS = 0.15
"""A strength whose gain stays below this share of the best candidate's is not searched any further."""
FREQUENCIES = 4
"""Peaks of the residuals' spectrum at which what ripples is tried."""
LOUD = 1e-3
"""Norm [sigma] of a change that is one."""
COSINE_MIN = 0.95
"""Signatures closer than this are one class: these runs cannot tell them apart."""


@dataclass(frozen=True)
class Signature:
    """What one candidate changes.

    Attributes:
        candidate: The effect.
        start: z from which its fit should begin, (m,): those it was simulated at, stretched to what is off.
        simulated: z that it was simulated at, (m,).
        projected: Whitened change that recalibration cannot absorb, at the typical strength or less, (n,).
        size: Norm of the whitened change [sigma], all samples together.
        kept: Share of the norm that recalibration cannot absorb.
        gain: Half the chi-squares that the signature takes off the residual (with the nominals refitted).
        reference: The fit that it was taken at, and from which its own begins.
    """

    candidate: Candidate
    start: Array
    simulated: Array
    projected: Array
    size: float
    kept: float
    gain: float
    reference: Fit


@dataclass(frozen=True)
class Screening:
    """What a candidate changes in the model.

    Attributes:
        candidate: The effect.
        columns: Whitened change at each of its starts that changes anything, with the start.
    """

    candidate: Candidate
    columns: tuple[tuple[tuple[float, ...], Array], ...]


@dataclass(frozen=True)
class Strength:
    """Where to start a candidate's fit: its unknowns z, (m,), and the half chi-squares that they gain there."""

    z: Array
    gain: float


class Projector:
    """Solves for the nominal parameters beside an added column.

    Args:
        fit: The recalibrated model, or one with effects in already.
        use: Samples that may be looked at, (n,).
    """

    def __init__(self, fit: Fit, use: Mask) -> None:
        self.jacobian = fit.jacobian[use]
        self.residual = fit.residual[use]
        self.use = use
        self.fit = fit
        self.normal = self.jacobian.T @ self.jacobian
        self.precision, self.limits = fit.space.prior_precision, fit.space.limits
        self.cost = self._cost(self.residual)

    def project(self, column: Array) -> Array:
        """Return the column less what the nominal parameters can do about it (within their tolerances), (n,)."""
        part = column[self.use]
        step = np.linalg.solve(self.normal + np.diag(self.precision + 1e-9), self.jacobian.T @ part)
        out: Array = column - self.fit.jacobian @ step
        return out

    def exact_gain(self, column: Array) -> float:
        """Return by how much the cost falls with the column as it is."""
        return self.cost - self._cost(self.residual - column[self.use])

    def gain(self, column: Array, signed: bool) -> tuple[float, float]:
        """Return by how much the cost falls with the column times its best stretch, and that stretch.

        Args:
            column: Whitened change, (n,).
            signed: Whether the stretch may be negative.
        """
        part = column[self.use]
        projected = self.project(column)[self.use]
        norm = float(projected @ part)
        stretch = float(projected @ self.residual) / norm if norm > 1e-12 else 1.0
        size = float(np.clip(abs(stretch), *STRETCH))
        stretch = -size if stretch < 0.0 and signed else size
        return self.cost - self._cost(self.residual - stretch * part), stretch

    def _cost(self, residual: Array) -> float:
        z = self.fit.z
        step = np.zeros(len(z))
        if len(z):
            step = solve_normal(self.normal, self.jacobian.T @ residual, self.precision, z, self.limits)
        rest = residual - self.jacobian @ step
        return 0.5 * float(rest @ rest + self.precision @ (z + step) ** 2)


def screen_candidates(predictor: Predictor, base: Fit, candidates: Sequence[Candidate], use: Mask) -> list[Screening]:
    """Simulate every candidate at each of its starts.

    Args:
        predictor: Simulations.
        base: The model as given, whose nominal parameters are about right once the effect is in: those of the
            recalibrated model are bent to make up for it.
        candidates: Effects that may be missing.
        use: Samples that may be looked at, (n,).
    """
    measurement = predictor.measurement
    swings: list[float] = []
    if any(axis.path.endswith(FREQUENCY_END) for candidate in candidates for axis in candidate.axes):
        swings = find_frequencies(predictor.dataset, measurement, measurement.scale(base.residual), use, FREQUENCIES)
    screenings = []
    for candidate in (with_frequencies(candidate, swings) for candidate in candidates):
        space = base.space.extend(candidate.axes, candidate.fixed)
        columns = simulate_changes(predictor, base, space, candidate, candidate.starts, screening=True)
        pairs = zip(candidate.starts, columns, strict=True)
        loud = tuple((start, column) for start, column in pairs if float(np.linalg.norm(column)) > LOUD)
        screenings.append(Screening(candidate, loud))
    return screenings


def rank_candidates(
    predictor: Predictor, fit: Fit, screenings: Sequence[Screening], use: Mask, recalibrated: Fit | None = None
) -> list[Signature]:
    """Return the best signature of every candidate that changes anything, the most promising first.

    Args:
        predictor: Simulations.
        fit: The model that the candidates were screened in, or one with an effect in it: what a second effect changes
            is taken to be the same with the first one as without.
        screenings: Of the candidates.
        use: Samples that may be looked at, (n,).
        recalibrated: The fit at which to look at what rounds readings: that needs readings which are about right, and
            no simulation. None: the same.
    """
    signatures = []
    projectors = {id(one): Projector(one, use) for one in (fit, recalibrated) if one is not None}
    for screening in screenings:
        rounds = screening.candidate.rounds
        projector = projectors[id(recalibrated if rounds and recalibrated is not None else fit)]
        if rounds:
            screening = screen_candidates(predictor, projector.fit, [screening.candidate], use)[0]
        signature = _find_signature(projector, screening)
        if signature is not None:
            signatures.append(signature)
    return sorted(signatures, key=lambda signature: -signature.gain)


def _find_signature(projector: Projector, screening: Screening) -> Signature | None:
    """Return the signature of the start that promises most, as it looks at the typical strength if it shows there."""
    candidate, fit, use = screening.candidate, projector.fit, projector.use
    limits = fit.space.extend(candidate.axes, candidate.fixed).limits_of(fit.space.size)
    amplitude = np.array([axis.path in candidate.amplitudes for axis in candidate.axes], dtype=bool)
    found: list[tuple[bool, Signature]] = []
    for start, column in screening.columns:
        norm = float(np.linalg.norm(column[use]))
        if norm < LOUD:
            continue
        projected = projector.project(column)
        kept = min(float(np.linalg.norm(projected[use])) / norm, 1.0)
        gain, stretch = (
            (projector.exact_gain(column), 1.0) if candidate.rounds else projector.gain(column, candidate.signed)
        )
        seen = np.array(start)
        begin = np.clip(np.where(amplitude, stretch * seen, seen), *limits)
        is_typical = bool(np.all(np.abs(seen[amplitude]) <= 1.0))
        found.append((is_typical, Signature(candidate, begin, seen, projected, norm, kept, gain, fit)))
    if not found:
        return None
    best = max((signature for _, signature in found), key=lambda signature: signature.gain)
    # Four times the typical strength of anything looks much the same: a tendon that does nothing, growth that stands.
    looks = max(found, key=lambda entry: (entry[0], entry[1].gain))[1]
    return replace(best, projected=looks.projected, size=looks.size, kept=looks.kept)


def simulate_changes(
    predictor: Predictor,
    base: Fit,
    space: Space,
    candidate: Candidate,
    starts: Sequence[Sequence[float] | Array],
    screening: bool = False,
) -> list[Array]:
    """Return the whitened changes of the prediction from ``base`` to a candidate at each of ``starts``, each (n,).

    In a screening, runs that the strongest starts do not touch are not simulated again.
    """
    here = base.space.setting(base.z)
    moves = [(candidate.name, space.setting(np.concatenate((base.z, start)))) for start in starts]
    changes: list[Array] = []
    if screening:
        changes += predictor.predict_changes(moves[: candidate.strong], here, mark_inert=True)
    changes += predictor.predict_changes(moves[len(changes) :], here)
    return [predictor.measurement.whiten(np.where(np.isfinite(change), change, 0.0)) for change in changes]


def search_strengths(
    predictor: Predictor, signatures: Sequence[Signature], use: Mask
) -> list[tuple[Strength, Signature]]:
    """Return where to start each fit, the most promising first.

    It is the strength along the signature that takes most off the residual: growth that stalls or a tendon that goes
    slack depend on it by leaps, over which no gradient leads.
    """
    projectors = {id(signature.reference): Projector(signature.reference, use) for signature in signatures}
    found = [(Strength(signature.start, -np.inf), signature) for signature in signatures]
    for factors in SEARCH:
        most = max((strength.gain for strength, _ in found), default=0.0)
        found = [
            (strength, signature)
            if np.isfinite(strength.gain) and strength.gain < HOPELESS * most
            else (_search(predictor, projectors[id(signature.reference)], signature, strength, factors), signature)
            for strength, signature in found
        ]
    return sorted(found, key=lambda pair: -pair[0].gain)


def _search(
    predictor: Predictor, projector: Projector, signature: Signature, strength: Strength, factors: Sequence[float]
) -> Strength:
    """Return the best of some multiples of a strength, and of itself."""
    base = signature.reference
    candidate = signature.candidate
    space = base.space.extend(candidate.axes, candidate.fixed)
    limits = space.limits_of(base.space.size)
    amplitude = np.array([axis.path in candidate.amplitudes for axis in candidate.axes], dtype=bool)
    if not amplitude.any():
        return Strength(signature.start, signature.gain)
    factors = ROUNDING_FINE if candidate.rounds else factors
    subsets = [amplitude]
    between: list[Array] = []
    if not np.isfinite(strength.gain) and not candidate.rounds:
        between = _bridge(signature, amplitude)
    if np.isfinite(strength.gain) and amplitude.sum() > 1:  # what acts in two ways may do so in another proportion
        subsets += [np.arange(candidate.size) == place for place in np.flatnonzero(amplitude)]
    starts = [
        np.clip(np.where(subset, factor * strength.z, strength.z), *limits)
        for subset in subsets
        for factor in factors
        if np.any(strength.z[subset] != 0.0)
    ]
    starts += between
    columns = simulate_changes(predictor, base, space, candidate, starts)
    tried = [Strength(z, projector.exact_gain(column)) for z, column in zip(starts, columns, strict=True)]
    return max(strength, *tried, key=lambda one: one.gain)


def _bridge(signature: Signature, amplitude: Mask) -> list[Array]:
    """Return the strength that was simulated, and one halfway to the one that it was stretched to, if that is far.

    An effect with a dead band is weaker than its stretched signature, or silent: what is true lies between the two. And
    where growth stalls beyond a threshold, a tenth of a strength may decide about everything.
    """
    start, seen = signature.start[amplitude], signature.simulated[amplitude]
    if np.any(start * seen < 0.0):
        return []
    simulated = np.where(amplitude, signature.simulated, signature.start)
    if np.all(np.abs(start) > NEAR_SHARE * np.abs(seen)):
        return [simulated]
    halfway = np.where(
        amplitude, np.sign(signature.start) * np.sqrt(np.abs(signature.start * signature.simulated)), signature.start
    )
    return [simulated, halfway]


def group_equivalent(signatures: Sequence[Signature], use: Mask) -> dict[str, list[str]]:
    """Return, for every candidate, those whose projected signature points the same way."""
    units = {}
    for signature in signatures:
        part = signature.projected[use]
        norm = float(np.linalg.norm(part))
        if norm > 0.0:
            units[signature.candidate.name] = part / norm
    return {
        name: [other for other, v in units.items() if other != name and abs(float(u @ v)) > COSINE_MIN]
        for name, u in units.items()
    }
