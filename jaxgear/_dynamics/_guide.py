"""Points on a curve of orbits: found by Newton's method, asked for folds and bifurcations."""

import concurrent.futures
import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float

from jaxgear._compiled import lasting
from jaxgear._dynamics._floquet import SlowModes, leading_multipliers, monodromy, slow_modes
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance
from jaxgear._dynamics._harmonic_problem import imbalance, linearised
from jaxgear._dynamics._orbit import Orbit, contact_force
from jaxgear._dynamics._types import Terms
from jaxgear._types import Reals, Scalar

if TYPE_CHECKING:
    Harmonics = np.ndarray
else:
    Harmonics = Float[np.ndarray, "coordinate term"]

# --- The equations in harmonics and speed


def sizes_of(balance: Balance) -> Terms:
    """Of the harmonics: a change by these has a mean square over time of one."""
    rows = jnp.full(balance.middle.shape[1], jnp.sqrt(2.0)).at[0].set(1.0)
    return balance.scales[:, None] * rows[None, :]


def joined_vector(balance: Balance, terms: Terms, speed: Scalar) -> Reals:
    """Harmonics and speed as one vector without units."""
    return jnp.append((terms / sizes_of(balance)).reshape(-1), jnp.log(speed))


def parted_vector(balance: Balance, unknowns: Reals) -> tuple[Terms, Scalar]:
    """Harmonics and speed."""
    sizes = sizes_of(balance)
    return unknowns[:-1].reshape(sizes.shape) * sizes, jnp.exp(unknowns[-1])


def slopes_by_both(balance: Balance, unknowns: Reals) -> tuple[Reals, Reals]:
    """The residual, and its derivative by harmonics and speed: a column more than rows."""
    terms, speed = parted_vector(balance, unknowns)
    residual, matrix = linearised(balance.at_speed(speed)[0], terms)

    def at(exponent: Scalar) -> Reals:
        problem = balance.at_speed(jnp.exp(exponent))[0]
        return imbalance(problem, terms)

    _, by_speed = jax.jvp(at, (unknowns[-1],), (jnp.ones(()),))
    columns = matrix * sizes_of(balance).reshape(1, -1)
    return residual.reshape(-1), jnp.concatenate([columns, by_speed.reshape(-1, 1)], axis=1)


# A step along the branch that takes more of Newton's steps is too long.
_MOST_NEWTON = 10


@lasting
def _correct(
    balance: Balance, first: Reals, normal: Reals, value: Scalar, tolerance: Scalar
) -> tuple[Reals, Reals, Scalar, Scalar]:
    """The point of the branch in a plane, its tangent on the side of the plane's normal, the
    imbalance one step before, and the number of steps.
    """

    def body(state):
        unknowns, _, _, steps = state
        residual, matrix = slopes_by_both(balance, unknowns)
        off = normal @ unknowns - value
        right = jnp.stack([jnp.append(residual, off), jnp.zeros_like(normal).at[-1].set(1.0)], 1)
        solved = jnp.linalg.solve(jnp.concatenate([matrix, normal[None, :]]), right)
        tangent = solved[:, 1] / jnp.sqrt(jnp.sum(solved[:, 1] ** 2))
        error = jnp.max(jnp.abs(residual))
        return unknowns - solved[:, 0], tangent, error, steps + 1.0

    def unfinished(state):
        return ~(state[2] <= tolerance) & (state[3] < _MOST_NEWTON)

    start = first, normal, jnp.asarray(jnp.inf), jnp.zeros(())
    return jax.lax.while_loop(unfinished, body, start)


@lasting
def _seen(balance: Balance, unknowns: Reals) -> tuple[Scalar, Scalar]:
    """Dynamic ratio and RMS of the transmission error of a point."""
    return _measures(balance, _orbit(balance, unknowns))


@lasting
def _seen_whole(balance: Balance, slow: SlowModes, unknowns: Reals) -> tuple[Scalar, Scalar, Reals]:
    """The same, and the monodromy matrix of the slow modes."""
    orbit, law = _orbit(balance, unknowns), balance.law
    matrix = monodromy(balance.system, slow.basis, orbit, law=law, follows=slow.follows)
    return *_measures(balance, orbit), matrix


def _orbit(balance: Balance, unknowns: Reals) -> Orbit:
    terms, speed = parted_vector(balance, unknowns)
    problem, responses = balance.at_speed(speed)
    none = jnp.zeros(())
    return balance.orbit(problem, responses, terms, none, none, 0.0)


def _measures(balance: Balance, orbit: Orbit) -> tuple[Scalar, Scalar]:
    system = balance.system
    error = orbit.motion @ system.transmission
    share = system.table.lengths / system.table.periods
    error = error - jnp.sum(share * error)
    ratio = jnp.max(contact_force(system, orbit)) / system.force
    return ratio, jnp.sqrt(jnp.sum(share * error**2))


@lasting
def first_vector(method: HarmonicBalance, balance: Balance, speed: Scalar, near: Terms) -> Reals:
    """The response that Newton's method reaches at a given speed."""
    return joined_vector(balance, method.solve(balance, speed, near)[1], speed)


# --- Along a branch


class Place(NamedTuple):
    """A point of a branch, and what is known of it."""

    unknowns: np.ndarray
    tangent: np.ndarray
    steps: int
    ratio: float = np.nan
    te_rms: float = np.nan
    multiplier: complex = complex(np.nan, np.nan)
    # Sign and logarithm of det(1 + M): it passes through zero as a multiplier passes through -1.
    doubling: tuple[float, float] = (1.0, 0.0)
    # Logarithm of the largest size of a complex multiplier.
    ring: float = -np.inf


def hides_event(here: Place, ahead: Place) -> bool:
    """Whether speed turns twice between two points, by the cubic through their tangents."""
    first, last = here.tangent[-1], ahead.tangent[-1]
    step = distance_between(ahead.unknowns, here.unknowns)
    between = 1.5 * (ahead.unknowns[-1] - here.unknowns[-1]) / step - 0.25 * (first + last)
    rises = (first + last) * (abs(first + last) > _UPRIGHT)
    return bool(first * last > -(_UPRIGHT**2) and between * rises < 0.0)


class LostError(Exception):
    """Newton's method failed within a step that had been taken."""


class Guide:
    """Takes steps along the branches of one balance."""

    def __init__(self, method: HarmonicBalance, balance: Balance, *, stability: bool):
        self.balance = balance
        self.tolerance = method.tolerance
        self.multiple = method.multiple
        self.stability = stability
        self.slow = slow_modes(balance.modes)
        self.steps = 0

    def correct(self, first: np.ndarray, normal: np.ndarray, value: float) -> Place | None:
        """The point in a plane, or nothing."""
        unknowns, tangent, error, steps = jax.device_get(
            _correct(self.balance, *map(jnp.asarray, (first, normal, value, self.tolerance)))
        )
        self.steps += int(steps)
        found = bool(error <= self.tolerance) and bool(np.all(np.isfinite(tangent)))
        return Place(unknowns, tangent, int(steps)) if found else None

    def see(self, point: Place) -> Place:
        """A point with all that is to be known of it."""
        if not self.stability:
            ratio, te_rms = jax.device_get(_seen(self.balance, jnp.asarray(point.unknowns)))
            return point._replace(ratio=float(ratio), te_rms=float(te_rms))
        return self._judged(point, *self._seen_whole(point))

    def _judged(
        self, point: Place, ratio: np.ndarray, te_rms: np.ndarray, matrix: np.ndarray
    ) -> Place:
        """A point whose response and monodromy matrix are known, with its stability."""
        found = leading_multipliers(matrix, self.slow.basis)
        sign, size = np.linalg.slogdet(np.eye(len(matrix)) + matrix)
        pairs = found[np.imag(found) != 0.0]
        return point._replace(
            ratio=float(ratio),
            te_rms=float(te_rms),
            multiplier=complex(found[0]),
            doubling=(float(sign), float(size)),
            ring=float(np.log(np.abs(pairs[0]))) if pairs.size else -np.inf,
        )

    def _seen_whole(self, point: Place) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return jax.device_get(_seen_whole(self.balance, self.slow, jnp.asarray(point.unknowns)))

    def see_all(self, points: list[Place]) -> list[Place]:
        """Points with all that is to be known of them; eigenvalues beside the next matrix.

        JAX's programs run one after the other: two of them at a time, with matrices of some hundred
        rows, have waited for each other for ever on two cores.
        """
        if not self.stability:
            return [self.see(point) for point in points]
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            judged = [
                pool.submit(
                    self._judged,
                    point,
                    *self._seen_whole(point),
                )
                for point in points
            ]
            return [each.result() for each in judged]

    def between(self, here: Place, ahead: Place, share: float) -> Place:
        """A point between two that are neighbours."""
        guess = here.unknowns + share * (ahead.unknowns - here.unknowns)
        found = self.correct(guess, here.tangent, float(here.tangent @ guess))
        if found is None:
            raise LostError
        return found

    def zero(
        self, here: Place, ahead: Place, of: Callable[[Place], float], accuracy: float
    ) -> Place:
        """The point between two where a function that has unlike signs there is zero."""
        ends = {0.0: of(here), 1.0: of(ahead)}
        value = lambda share: ends[share] if share in ends else of(self.between(here, ahead, share))
        step = float(here.tangent @ (ahead.unknowns - here.unknowns))
        share = scipy.optimize.brentq(value, 0.0, 1.0, xtol=accuracy / step, full_output=False)
        return self.between(here, ahead, float(cast(float, share)))

    def fold(self, here: Place, ahead: Place) -> Place:
        """Where the branch turns back between two points."""
        return self.zero(here, ahead, lambda point: point.tangent[-1], _FOLD_ACCURACY)

    def changes(self, points: list[Place]) -> "tuple[Events, Events]":
        """Where, among points that are seen, a period doubles, and where a torus begins."""
        whole = lambda point: point if np.isfinite(point.ratio) else self.see(point)
        doublings: Events = []
        tori: Events = []
        for index, (here, ahead) in enumerate(itertools.pairwise(points)):

            def by_sign(point: Place, scale: float = here.doubling[1]) -> float:
                sign, size = whole(point).doubling
                return sign * np.exp(size - scale)

            if here.doubling[0] * ahead.doubling[0] < 0.0:
                doublings.append((index, self.passage(here, ahead, by_sign)))
            # Complex multipliers that meet and become real leave this without passing the circle.
            if here.ring * ahead.ring < 0.0 and np.isfinite(here.ring * ahead.ring):
                found = self.passage(here, ahead, lambda point: whole(point).ring)
                if abs(found.ring) < _ON_CIRCLE:
                    tori.append((index, found))
        return doublings, tori

    def passage(self, here: Place, ahead: Place, of: Callable[[Place], float]) -> Place:
        """Where a function of the multipliers passes through zero, or the point before it."""
        try:
            return self.see(self.zero(here, ahead, of, _PASSAGE_ACCURACY))
        except LostError:
            return here

    def shifted(self, unknowns: np.ndarray, cycles: int) -> np.ndarray:
        """The same response, some cycles later."""
        width = self.balance.scales.size
        terms = unknowns[:-1].reshape(width, -1)
        count = terms.shape[1] // 2
        order = np.arange(1, count + 1)
        # Harmonics are counted in the response's own frequency.
        angle = 2.0 * np.pi * order * cycles / self.multiple
        cosines, sines = terms[:, 1 : count + 1], terms[:, count + 1 :]
        turned = [
            terms[:, :1],
            cosines * np.cos(angle) + sines * np.sin(angle),
            sines * np.cos(angle) - cosines * np.sin(angle),
        ]
        return np.append(np.concatenate(turned, axis=1).reshape(-1), unknowns[-1])

    def joint(self, here: Place, ahead: Place) -> Place | None:
        """Where, between two points, the response repeats after fewer cycles, if it does."""
        for cycles in (d for d in range(1, self.multiple) if self.multiple % d == 0):
            part = lambda point, c=cycles: point.unknowns - self.shifted(point.unknowns, c)
            before = part(here)
            size = np.sqrt(before @ before)
            if size < _SAME or before @ part(ahead) > 0.0:
                continue
            # Two branches cross at zero, where neither has a tangent: a little before it.
            of = lambda point: float(part(point) @ before / size - 0.1 * _SAME)  # noqa: B023
            found = self.zero(here, ahead, of, 0.01 * _SAME)
            left = part(found)
            if np.sqrt(left @ left) < _SAME:
                return found
        return None

    def passes(self, here: Place, ahead: Place, first: Place) -> bool:
        """Whether a step comes back to the first point, or to the same response some cycles on."""
        chord = ahead.unknowns - here.unknowns
        for cycles in range(self.multiple):
            goal = self.shifted(first.unknowns, cycles)
            along = (goal - here.unknowns) @ chord / (chord @ chord)
            aside = distance_between(goal, here.unknowns + along * chord)
            if 0.0 < along <= 1.0 and aside < 0.5 * np.sqrt(chord @ chord):
                met = self.correct(here.unknowns + along * chord, chord, float(goal @ chord))
                if met is not None and distance_between(met.unknowns, goal) < _SAME:
                    return True
        return False


# Along a branch: of folds, and of changes of stability. The multipliers of exact contact jump by
# little as cells close: so far may a pair of them be off the circle where they pass it.
_FOLD_ACCURACY, _PASSAGE_ACCURACY, _ON_CIRCLE = 1e-9, 1e-7, 1e-2

# Distance between responses that are one, and tangents that do not lean to either side.
_SAME, _UPRIGHT = 1e-4, 1e-9


def distance_between(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two points of a curve, in its scaled unknowns [-]."""
    return float(np.sqrt(np.sum((first - second) ** 2)))


def heading_of(point: Place) -> float:
    """Whether speed rises or falls along the branch, 0 if it does neither but for rounding."""
    return float(np.sign(point.tangent[-1])) if abs(point.tangent[-1]) > _UPRIGHT else 0.0


# Points, each with the index of the point before it.
Events = list[tuple[int, Place]]
