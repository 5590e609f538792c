r"""Harmonic balance on the mesh coordinates, with contact evaluated in time.

All but the contact is linear and is eliminated by its receptance $R(i\omega) = V^TZ^{-1}V$, with
$Z(s) = s^2M + s(C + \Omega_1G) + K + V\bar kV^T$: unknown are the harmonics of the few mesh
coordinates alone, whatever the size of the structure. With $n = m + Bg$ the motion of the nodes,
harmonic $h$ is in balance when
$\hat n_h = \hat n_h^0 - R(ih\omega)(\hat g_h - \bar k\hat n_h)$, where $\hat n^0$ answers the
constant load, and loads that swing beside those of the mesh. The mean mesh stiffness $\bar k$
cancels; in the linear part it makes Newton's method converge from the quasi-static state.

Derivatives are those of the solution, by the implicit function theorem.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import InputError, require
from jaxgear._compiled import compiled, lasting, lasting_rare
from jaxgear._dynamics._harmonic_basis import (
    HarmonicAnalysis,
    HarmonicValues,
    analysis_of,
    basis_of,
    closest_terms,
    periodic_analysis,
    periodic_basis,
    rates_of,
)
from jaxgear._dynamics._harmonic_problem import (
    Problem,
    excess_stiffness,
    is_long,
    loads_of,
    motion_of_nodes,
    root_of,
)
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._orbit import AbstractMethod, Orbit, mesh_scales
from jaxgear._dynamics._receptance import AbstractAnswers, answers_of
from jaxgear._dynamics._system import DynamicSystem, ModalBasis, modal_basis
from jaxgear._dynamics._table import END, MIDDLE, START, MeshTable, mesh_at
from jaxgear._dynamics._types import Start, StepPlaces, Terms, Waves
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import Coordinates, Reals, Scalar


class HarmonicBalance(AbstractMethod):
    """Harmonic balance with alternating frequency and time (theory 8.13 to theory 9.2).

    **Fields:**

    - `law`: exact or smooth contact.
    - `harmonics`: of the mesh frequency that are kept.
    - `averaged`: whether exact contact is averaged over each time step instead of evaluated in its
        middle. Derivatives near the loss of contact are then a hundred times closer to those of
        continuous time, at twice the cost.
    - `multiple`: cycles after which the response repeats; 2 finds sub-harmonic responses, from a
        start on one.
    - `bilinear`: whether time is discretised as by `Midpoint`, whose motion in mid-steps this then
        is to rounding, if steps are equally long, all harmonics are kept and cells do not damp: a
        test of both.
    - `tolerance`: imbalance at which the response counts as settled, in static deflections [-].
    - `most_steps`: Newton steps and halvings after which the method gives up.
    """

    law: AbstractContactLaw = eqx.field(default_factory=ExactContact)
    harmonics: int = eqx.field(static=True, default=20)
    averaged: bool = eqx.field(static=True, default=False)
    multiple: int = eqx.field(static=True, default=1)
    bilinear: bool = eqx.field(static=True, default=False)
    tolerance: float = eqx.field(static=True, default=1e-9)
    most_steps: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require(
            self.harmonics >= 1,
            "`HarmonicBalance.harmonics` must be at least 1, got {got}.",
            got=self.harmonics,
        )
        require(
            not self.averaged or isinstance(self.law, ExactContact),
            "`HarmonicBalance.averaged` is for `ExactContact`: smooth contact needs no average.",
        )

    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None = None) -> Orbit:
        """Find the response at one speed; see `AbstractMethod`.

        Newton's method begins at the quasi-static states. To begin at harmonics that are known,
        see `solve`.

        **Raises:**

        - `ValueError` if a `start` is given.
        """
        if start is not None:
            raise InputError(
                "Harmonic balance starts from harmonics, not from a motion. Step from the motion "
                "(`TimeStepping`, `Shooting`), or leave `start` out."
            )
        return self.solve(harmonic_balance_problem(self, system), speed)[0]

    @lasting
    def solve(
        self, balance: "Balance", speed: Scalar, near: Terms | None = None
    ) -> tuple[Orbit, Terms]:
        """Find the response that Newton's method reaches from given harmonics.

        **Arguments:**

        - `balance`: what all speeds share, from `harmonic_balance_problem` with this method.
        - `speed`: of the pinion [rad/s].
        - `near`: harmonics of the mesh coordinates to begin with, or `None`: those of the
            quasi-static states [m, rad].

        **Returns:**

        The response, settled or not, and its harmonics.
        """
        problem, answers = balance.at_speed(speed)
        first = balance.rest if near is None else near
        terms, residual, steps = root_of((self.tolerance, self.most_steps), problem, first)
        return balance.orbit(problem, answers, terms, residual, steps, self.tolerance), terms


class Balance(eqx.Module):
    """What the balances at all speeds share.

    **Fields:**

    - `system`: what moves, its table as long as the response.
    - `modes`: with which the dynamic stiffness of the structure is inverted.
    - `law`: exact or smooth contact.
    - `samples`: the cells at mid-steps or, averaged, at each place of the steps.
    - `times`: values of the harmonics where contact is evaluated [-].
    - `middle`: values of the harmonics at mid-steps [-].
    - `analysis`: harmonics of what is known at mid-steps [-].
    - `scales`: of the mesh coordinates [m, rad].
    - `rest`: harmonics of the quasi-static states [m, rad].
    - `bilinear`: whether time is discretised as by `Midpoint`.
    - `beside`: periodic loads on all degrees of freedom beside those of the mesh and the constant
        one: complex amplitudes by harmonics from the zeroth, or `None` [N, N m].
    """

    system: DynamicSystem
    modes: ModalBasis
    law: AbstractContactLaw
    samples: tuple[Mesh, ...]
    times: tuple[HarmonicValues, ...]
    middle: HarmonicValues
    analysis: HarmonicAnalysis
    scales: Coordinates
    rest: Terms
    bilinear: bool = eqx.field(static=True)
    beside: Waves | None = None

    @property
    def count(self) -> int:
        """Number of harmonics of the response's own frequency."""
        return (self.middle.shape[1] - 1) // 2

    def with_cells(self, table: MeshTable) -> "Balance":
        """The same of a mesh whose cells have other gaps.

        **Arguments:**

        - `table`: as that of the system, but for its gaps.

        **Returns:**

        The balance.
        """
        parts = (START, MIDDLE, END) if len(self.samples) > 1 else (MIDDLE,)
        samples = tuple(mesh_at(table, part) for part in parts)
        system = dataclasses.replace(self.system, table=table)
        return dataclasses.replace(self, system=system, samples=samples)

    def at_speed(self, speed: Scalar) -> tuple["Problem", AbstractAnswers]:
        """The balance at one speed, and what the structure answers to mesh loads.

        **Arguments:**

        - `speed`: of the pinion [rad/s].

        **Returns:**

        The equations, and what the structure answers to loads of the mesh.
        """
        system = self.system
        base = 2.0 * jnp.pi / (system.mesh_period(speed) * system.table.periods)
        order = jnp.arange(self.count + 1, dtype=float)
        frequency = order * base
        if self.bilinear:
            step = 2.0 * jnp.pi / (base * self.middle.shape[0])
            frequency = 2.0 / step * jnp.tan(0.5 * step * frequency)
        # The mean is real, and found together with what the constant load does.
        steady, swings = system.load_at(speed), None
        if self.beside is not None:
            steady, swings = steady + jnp.real(self.beside[0]), self.beside[1:]
        loads = jnp.column_stack([system.vectors, steady])
        constant = jnp.linalg.solve(system.stiffness_at(speed), loads)
        mean, beside = constant[:, :-1], constant[None, :, -1]
        answers = answers_of(system, self.modes, frequency[1:], speed, mean, swings)
        if answers.beside is not None:
            beside = jnp.concatenate([beside, jnp.real(answers.beside), -jnp.imag(answers.beside)])
        receptance = answers.receptance()
        at_rest = (system.vectors.T @ mean)[None]
        problem = Problem(
            law=self.law,
            samples=tuple(mesh.at(speed) for mesh in self.samples),
            times=self.times,
            rates=rates_of(self.middle, base),
            analysis=self.analysis,
            real=jnp.concatenate([at_rest, jnp.real(receptance)]),
            imaginary=jnp.concatenate([jnp.zeros_like(at_rest), jnp.imag(receptance)]),
            beside=beside,
            met=(beside @ system.vectors).T,
            mean=system.mean,
            bow=system.bow,
            cell_damping=system.cell_damping,
            scales=self.scales,
            speed=speed,
            base=base,
        )
        return problem, answers

    def orbit(
        self,
        problem: "Problem",
        answers: AbstractAnswers,
        terms: Terms,
        residual: Scalar,
        steps: Scalar,
        tolerance: float,
    ) -> Orbit:
        """The response in time.

        **Arguments:**

        - `problem`, `answers`: from `at_speed`.
        - `terms`: harmonics of the mesh coordinates [m, rad].
        - `residual`, `steps`, `tolerance`: how they were found.

        **Returns:**

        The response.
        """
        elastic, total, _ = loads_of(problem, terms)
        load = (self.analysis @ total)[:, :, None]
        nodes = motion_of_nodes(problem, terms.T[:, :, None], load)
        excess = excess_stiffness(problem, nodes, load)[:, :, 0]
        # Minus V (g - k n), harmonic by harmonic, through the structure.
        motion = answers.motion(-excess)
        motion = motion.at[: len(problem.beside)].add(problem.beside)
        count = self.count
        sine = motion[count + 1 :]
        order = jnp.arange(1, count + 1, dtype=float)
        velocity = problem.base * jnp.sum(order[:, None] * sine, axis=0)
        return Orbit(
            speed=problem.speed,
            place=self.middle @ terms.T,
            load=elastic,
            motion=self.middle @ motion,
            start=jnp.stack([jnp.sum(motion[: count + 1], axis=0), velocity]),
            residual=residual,
            settled=(residual <= tolerance) & jnp.all(jnp.isfinite(terms)),
            steps=steps,
        )


@lasting_rare
def harmonic_balance_problem(method: HarmonicBalance, system: DynamicSystem) -> Balance:
    """Prepare what all speeds share.

    **Arguments:**

    - `method`: settings.
    - `system`: what moves.

    **Returns:**

    The balance.

    **Raises:**

    - `ValueError` if a response has too few time steps for its harmonics.
    """
    require(
        not method.averaged or system.cell_damping is None,
        "Contact with damping of its own cannot be averaged over steps: leave "
        "`HarmonicBalance.averaged` out.",
    )
    system = system.over(method.multiple)
    table = system.table
    steps, count = len(table.kinds), method.harmonics * table.periods
    require(
        2 * count < steps,
        "{count} harmonics need more than {least} time steps, got {steps}. Raise the number of "
        "phases in a mesh period, or lower `HarmonicBalance.harmonics`.",
        count=count,
        least=2 * count,
        steps=steps,
    )
    unknowns = system.vectors.shape[1] * (2 * count + 1)
    begin, middle, end, analysis = _transforms(
        table, count, averaged=method.averaged, long=is_long(unknowns)
    )
    times = (begin, end) if method.averaged else (middle,)
    parts = (START, MIDDLE, END) if method.averaged else (MIDDLE,)
    return Balance(
        system=system,
        modes=modal_basis(system),
        law=method.law,
        samples=tuple(mesh_at(table, part) for part in parts),
        times=times,
        middle=middle,
        analysis=analysis,
        scales=mesh_scales(system),
        rest=(analysis @ jnp.tile(system.rest, (method.multiple, 1))).T,
        bilinear=method.bilinear,
    )


def _transforms(
    table: MeshTable, count: int, *, averaged: bool, long: bool
) -> tuple[HarmonicValues, HarmonicValues, HarmonicValues, HarmonicAnalysis]:
    """Values where steps begin, in their middles and where they end; harmonics of what is there."""
    edges, periods = table.edges, table.periods
    if not long:
        share = edges / periods
        begin, end = (basis_of(each, count) for each in (share[:-1], share[1:]))
        middle = basis_of(0.5 * (share[1:] + share[:-1]), count)
        return begin, middle, end, analysis_of(middle, jnp.diff(share), averaged=averaged)
    edges = edges[: len(table.kinds) // periods + 1]
    places = edges[:-1], 0.5 * (edges[1:] + edges[:-1]), edges[1:]
    begin, middle, end = (periodic_basis(each, count, periods) for each in places)
    analysis = periodic_analysis(middle, jnp.diff(edges) / periods, averaged=averaged)
    return begin, middle, end, analysis


def fourier_coefficients(balance: Balance, places: StepPlaces) -> Terms:
    """Harmonics of a response that was found by any method on the same time steps.

    **Arguments:**

    - `balance`: whose harmonics they are to be.
    - `places`: mesh coordinates of the response in mid-steps, over as many cycles as the balance,
        or over a divisor of them [m, rad].

    **Returns:**

    Harmonics of the mesh coordinates: those closest to the response in mid-steps [m, rad].

    **Raises:**

    - `ValueError` unless the response divides the time of the balance.
    """
    steps, found = balance.middle.shape[0], places.shape[0]
    require(
        steps % found == 0,
        "The response has {found} time steps and the balance {steps}: both must have the same "
        "table, and `multiple` of the balance that of the response or a multiple of it.",
        found=found,
        steps=steps,
    )
    place = places if steps == found else jnp.tile(places, (steps // found, 1))
    return _closest(balance.middle, balance.system.table.lengths, place)


@compiled
def _closest(values: HarmonicValues, lengths: Reals, place: StepPlaces) -> Terms:
    """Harmonics closest to a response in mid-steps; a whole balance is slow to pass."""
    return closest_terms(values, lengths, place).T
