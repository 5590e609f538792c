r"""The elastic body under the teeth: a ring clamped at its bore and loaded at the root circle.

Plane strain, any Poisson's ratio. Lengths are in units of the root radius and every influence is
displacement times $E b$ over load, a pure number. Polar components $(r, \theta)$, $\theta$ and
$+Z$ turning the same way. The exact solution is a Fourier series in $\theta$ (Michell), of which
the solid disc's share is summed in closed form and only the difference that the bore makes is
left to the series. Sainsot, Velex & Duverger 2004 fitted a polynomial to the same ring.
"""

from typing import TYPE_CHECKING, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._contact._ring_disc import ROOT_NODES, disc_mean, disc_point, gauss_legendre
from jaxgear._contact._tooth import tooth_load
from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Reals, Scalar

if TYPE_CHECKING:
    Resultants = Array
    Influences = Array
    Receptances = Array
    Tractions = Array
else:
    Resultants = Float[Array, "*point resultant"]
    Influences = Float[Array, "neighbour displacement resultant"]
    Receptances = Float[Array, "component traction order"]
    Tractions = Float[Array, "node resultant component"]

Traction = Literal["parallel", "radial"]
Measure = Literal["mean", "point"]


# --- one harmonic of the ring


class _Square(NamedTuple):
    """A 2 x 2 matrix per order, by rows."""

    a: Reals
    b: Reals
    c: Reals
    d: Reals


def _inverse(matrix: _Square) -> _Square:
    a, b, c, d = matrix
    determinant = a * d - b * c
    return _Square(d / determinant, -b / determinant, -c / determinant, a / determinant)


def _product(left: _Square, right: _Square) -> _Square:
    a, b, c, d = left
    return _Square(
        a * right.a + b * right.c,
        a * right.b + b * right.d,
        c * right.a + d * right.c,
        c * right.b + d * right.d,
    )


def _less(left: _Square, right: _Square) -> _Square:
    return _Square(*(x - y for x, y in zip(left, right, strict=True)))


def _waves(order: Reals, kolosov: Scalar, radius_ratio: Scalar) -> _Square:
    r"""Receptances for orders from one on, by Michell's solutions $r^{\pm n}, r^{\pm n+2}$.

    Growing solutions are scaled at the rim and decaying ones at the bore: no power overflows.
    Order one takes the logarithmic solution in the place of $r^n$, which is a translation there
    just as $r^{-n+2}$ is.
    Radial components come first, then tangential ones.
    """
    n, kappa, shear, pull = order, kolosov, order * (order + 1.0), order * (order - 1.0)
    near = jnp.exp(-(n - 1.0) * jnp.log(radius_ratio))
    far = near / radius_ratio**2
    first, turn = order == 1.0, 2.0 * kappa * jnp.log(radius_ratio)
    rising, sliding = kappa - 1.0 - n, kappa + 1.0 + n
    steep, slow = kappa - 1.0 + n, n - kappa - 1.0
    bore = _Square(
        jnp.where(first, 1.0 + turn, -n * near),
        rising * far,
        jnp.where(first, 1.0 - turn, n * near),
        sliding * far,
    )
    share = _product(_inverse(_Square(n, steep, n, slow)), bore)
    rim = _Square(jnp.where(first, 1.0, -n), rising, n, sliding)
    displacement = _less(rim, _product(_Square(n * far, steep * near, n * far, slow * near), share))
    grown = _Square(
        jnp.where(first, -kappa - 3.0, -pull),
        -(n + 1.0) * (n - 2.0),
        jnp.where(first, kappa - 1.0, pull),
        shear,
    )
    decayed = _Square(-shear * far, -(n + 2.0) * (n - 1.0) * near, -shear * far, -pull * near)
    traction = _less(grown, _product(decayed, share))
    return _product(displacement, _inverse(traction))


def ring_receptances(
    *, radius_ratio: Scalar, poisson: Scalar, harmonics: int
) -> Float[Array, "component traction order"]:
    r"""What the rim of a clamped ring does under a harmonic traction (Michell's solutions).

    Tractions $\sigma_{rr}\cos n\theta$ and $\sigma_{r\theta}\sin n\theta$ give displacements
    $u_r\cos n\theta$ and $u_\theta\sin n\theta$. Tractions $\sin n\theta$ and $-\cos n\theta$
    give displacements $\sin n\theta$ and $-\cos n\theta$ through the same matrix.

    **Arguments:**

    - `radius_ratio`: $h$, rim radius over bore radius [-].
    - `poisson`: Poisson's ratio [-].
    - `harmonics`: the last order $n$, at least 1.

    **Returns:**

    Displacement times $2G$ over traction times rim radius [-], for orders 0 to `harmonics`.
    """
    kolosov, squared = 3.0 - 4.0 * poisson, radius_ratio**2
    waves = _waves(jnp.asarray(np.arange(1.0, harmonics + 1.0)), kolosov, radius_ratio)
    # Order zero: radial growth, and torsion.
    growth = (squared - 1.0) / (2.0 * squared / (kolosov - 1.0) + 1.0)
    none = jnp.zeros_like(growth)
    entries = zip((growth, none, none, squared - 1.0), waves, strict=True)
    joined = [jnp.concatenate([zero[None], rest]) for zero, rest in entries]
    return jnp.stack(joined).reshape(2, 2, harmonics + 1)


def _without_disc(receptances: Receptances, kolosov: Scalar) -> Receptances:
    """What the bore adds to a solid disc's receptance, which is taken off from order two on."""
    n = np.arange(float(receptances.shape[-1]))
    outer = kolosov * jnp.asarray(np.where(n < 2.0, 0.0, 0.5 / (n + 1.0)))
    inner = jnp.asarray(np.where(n < 2.0, 0.0, 0.5 / np.maximum(n - 1.0, 1.0)))
    direct, cross = outer + inner, outer - inner
    return receptances - jnp.stack([direct, cross, cross, direct]).reshape(receptances.shape)


# --- what a tooth does to its root


def _tractions(kind: Traction, root_half_angle: Scalar) -> Tractions:
    r"""Tractions at the Gauss nodes, times $r_f\theta_f$, under unit $N$, $Q$ and $M/r_f$."""
    half = root_half_angle
    node = jnp.asarray(gauss_legendre().nodes)
    angle = half * node
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    level, none = 0.5 * jnp.ones_like(angle), jnp.zeros_like(angle)
    if kind == "radial":
        tilt = -1.5 * node / half
        columns = [(level, none), (none, level), (tilt, none)]
        return jnp.stack([jnp.stack(pair, axis=-1) for pair in columns], axis=1)
    # Along the centreline, linear in the chord coordinate, of unit moment about the root point.
    weights = jnp.asarray(gauss_legendre().weights)
    tilt = -sine / (weights @ sine**2)
    moment = jnp.stack([tilt * cosine, -tilt * sine], axis=-1)
    normal = jnp.stack([level * cosine, -level * sine], axis=-1)
    # A uniform tangential traction follows the arc, and acts below the root point by the arc's
    # mean sag: the moment makes up for it.
    sag = weights @ jnp.sin(0.5 * angle) ** 2
    tangential = jnp.stack([level * sine, level * cosine], axis=-1) + sag * moment
    return jnp.stack([normal, tangential, moment], axis=1)


def _amplitudes(tractions: Tractions, root_half_angle: Scalar, harmonics: int) -> Array:
    r"""Of each resultant's tractions, in the form that `ring_receptances` takes them.

    $N$ is symmetric about the centreline and takes cos, sin; $Q$ and $M$ take sin, -cos.
    """
    # Their integrands are even: half the nodes will do.
    right = slice(ROOT_NODES // 2, None)
    basis, tractions = gauss_legendre(), tractions[right]
    orders = jnp.asarray(np.arange(harmonics + 1.0))
    turn = (root_half_angle * jnp.asarray(basis.nodes[right]))[:, None] * orders[None]
    weights = 2.0 * jnp.asarray(basis.weights[right])[:, None]
    cosine, sine = weights * jnp.cos(turn), weights * jnp.sin(turn)
    even = jnp.stack([cosine, sine], axis=1)
    odd = jnp.stack([sine, -cosine], axis=1)
    symmetric = jnp.einsum("kc,kcn->cn", tractions[:, 0], even)
    other = jnp.einsum("kjc,kcn->jcn", tractions[:, 1:], odd)
    return jnp.concatenate([symmetric[None], other])


def _point_amplitudes(harmonics: int) -> np.ndarray:
    r"""The same of $u_r$, $u_\theta$ and the rotation at the root point."""
    n = np.arange(harmonics + 1.0)
    one, none = np.ones_like(n), np.zeros_like(n)
    return np.stack([np.stack([one, none]), np.stack([none, -one]), np.stack([-n, -one])])


def _series(measured: Array, loaded: Array, receptances: Receptances, shifts: Reals) -> Influences:
    r"""$\frac{1}{\pi}\sum_n m_i R_n s_j$ times the cosine or sine of $n$ times the shift."""
    orders = np.arange(float(receptances.shape[-1]))
    terms = jnp.einsum("iar,abr,jbr->ijr", measured, receptances, loaded)
    terms = terms * jnp.asarray(np.where(orders == 0.0, 0.5, 1.0) / np.pi)[None, None]
    turn = shifts[:, None] * jnp.asarray(orders)[None]
    cosine = jnp.einsum("kr,ijr->kij", jnp.cos(turn), terms)
    sine = jnp.einsum("kr,ijr->kij", jnp.sin(turn), terms)
    # The parity of displacement and load about their own centrelines decides which.
    parity = np.asarray([1.0, -1.0, -1.0])
    same = 0.5 * (1.0 + np.outer(parity, parity))
    cross = 0.5 * (parity[:, None] - parity[None])
    return jnp.asarray(same)[None] * cosine + jnp.asarray(cross)[None] * sine


# --- teeth on the ring


def ring_influence(
    *,
    radius_ratio: Scalar,
    root_half_angle: Scalar,
    poisson: Scalar,
    pitch_angle: Scalar,
    neighbours: int,
    harmonics: int,
    traction: Traction = "parallel",
    measure: Measure = "mean",
) -> Float[Array, "neighbour displacement resultant"]:
    r"""What a load at one tooth's root does to the roots of that tooth and of its neighbours.

    The resultants are $N$ outward along the tooth's centreline, $Q$ in the direction of
    $+\theta$, and $M$ about $+Z$ and the root point (on the centreline, at $r_f$), so that $Q$ at
    a height $u$ above it has $M = uQ$. They act on the arc $|\theta|\le\theta_f$.

    - `"parallel"` tractions point along the tooth's own axes: $N$ and $Q$ uniform, $M$ linear in
        the chord coordinate. Forces and moment are exact, and so is the torque $Q r_f + M$.
    - `"radial"` tractions are the literature's: $N$ uniform and $M$ linear, both radial, $Q$
        uniform and tangential. Forces and moment are accurate to $\theta_f^2$, but $M$ brings with
        it a force $-M/r_f$ along $Q$, and so no torque.
    - `"mean"` displacements are weighted as the tractions are. The matrix is then symmetric, and
        all teeth of a gear together have a positive semi-definite one.
    - `"point"` displacements are those of the root point, with the rotation
        $(u_\theta - \partial u_r/\partial\theta)/r$.

    A tooth at $-\Delta\theta$ has the matrix of $\Delta\theta$ with the signs of rows and columns
    of $u_\theta$ and $\psi$ changed; with `"mean"` that is the transpose. The roots must not
    overlap: $2\theta_f\le$ `pitch_angle`.

    **Arguments:**

    - `radius_ratio`: $h$, root radius over the radius of the clamped bore, above 1 [-].
    - `root_half_angle`: $\theta_f$, half the angle of a tooth at the root circle [rad].
    - `poisson`: Poisson's ratio [-].
    - `pitch_angle`: between two teeth [rad].
    - `neighbours`: how many teeth on one side to look at.
    - `harmonics`: last order $N$ of the series. The bore's share in order $n$ falls as $h^{-2n}$:
        four orders per tooth leave about 1e-6 of an influence where the rim is a module thick.
    - `traction`: `"parallel"` or `"radial"`.
    - `measure`: `"mean"` or `"point"`.

    **Returns:**

    Displacement times $E b$ over load [-]: for the teeth at 0, 1 ... `neighbours` pitches, rows
    $u_r$, $u_\theta$, $r_f\psi$, columns $N$, $Q$, $M/r_f$.

    **Raises:**

    - `ValueError` if the ring has no thickness, or the roots overlap.
    """
    require(
        radius_ratio > 1.0,
        "`radius_ratio` must exceed 1, got {got:.6g}. It is root radius over bore radius.",
        got=radius_ratio,
    )
    require(
        (root_half_angle > 0.0) & (2.0 * root_half_angle < pitch_angle + 1e-9),
        "`root_half_angle` must lie between 0 and half of `pitch_angle`, got {got:.6g} rad at a "
        "pitch of {pitch:.6g} rad. It is half the angle of a tooth.",
        got=root_half_angle,
        pitch=pitch_angle,
    )
    kolosov = 3.0 - 4.0 * poisson
    shifts = pitch_angle * jnp.asarray(np.arange(neighbours + 1.0))
    receptances = ring_receptances(radius_ratio=radius_ratio, poisson=poisson, harmonics=harmonics)
    tractions = _tractions(traction, root_half_angle)
    loaded = _amplitudes(tractions, root_half_angle, harmonics)
    if measure == "mean":
        measured, disc = loaded, disc_mean
    else:
        measured, disc = jnp.asarray(_point_amplitudes(harmonics)), disc_point
    bore = _series(measured, loaded, _without_disc(receptances, kolosov), shifts)
    solid = disc(tractions, root_half_angle, kolosov, shifts)
    return (1.0 + poisson) * (solid + bore)


def root_resultants(section: ToothSection, roll_angle: Reals) -> Resultants:
    r"""Resultants at a tooth's root of a unit normal load, for `ring_influence`.

    $s = [-\sin\alpha_p, \cos\alpha_p, \cos\alpha_p\,u/r_f]$, the load pushing in the direction of
    $+\theta$. The compliance that the body adds between the contacts $i$ and $j$ is
    $s_i\cdot B(\theta_i - \theta_j)\cdot s_j/E$.

    **Arguments:**

    - `section`: the tooth.
    - `roll_angle`: of the loaded points [rad].

    **Returns:**

    $N$, $Q$, $M/r_f$ over the load [-], last axis.
    """
    load = tooth_load(section, roll_angle)
    cosine = jnp.cos(load.angle)
    arm = load.height / section.root_radius - 1.0
    return jnp.stack([-jnp.sin(load.angle), cosine, cosine * arm], axis=-1)


def give_alone(influence: Float[Array, "displacement resultant"], resultants: Resultants) -> Reals:
    """Motion along its own load of a tooth loaded alone, in the unit of `influence`.

    **Arguments:**

    - `influence`: of a root on itself, from `ring_influence`.
    - `resultants`: of unit loads, from `root_resultants`.

    **Returns:**

    The motion at each point.
    """
    return jnp.sum((resultants @ influence) * resultants, axis=-1)
