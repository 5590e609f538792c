r"""Nodal diameters and circles of mode shapes on any grid, and which pairs of modes split.

A mode with $n$ nodal diameters moves as $\cos(n\theta-\varphi)$ around the axis, its tangential
part as the sine. Weights stand for mass, so that energies are kinetic.
"""

from dataclasses import dataclass

import numpy as np

from ._checks import require

KINDS = ("radial", "tangential", "axial")

# Coordinates in a text file have about seven digits: nodes of one ring, as a part of the radius.
_RING = 1e-5
# Nodes beyond this part of the largest radius tell how wide the toothed face is.
_FACE = 0.95
# What moves less than this part of the largest amplitude has no sign.
_QUIET = 0.05
# Means over the face that are rounding, of the largest motion that they are means of.
_SILENT = 1e-6
# Scattered nodes: so many per unknown amplitude, and so many groups, or circles are not seen.
_SPARE, _LEAVES = 2.5, 8
# Eigenvalues of the normal equations, against the largest, that the nodes do not tell from zero.
_FAINT = 1e-3


@dataclass(frozen=True)
class NodalPattern:
    """What mode shapes look like around the axis and along the radius.

    **Fields:**

    - `diameter`: nodal diameters $n$ of most energy, shape `[mode]` [-].
    - `circle`: nodal circles $s$, shape `[mode]` [-]; see `identify`.
    - `share`: share of the energy that $n$ has, shape `[mode]` [-].
    - `kind`: where most motion goes: "radial", "tangential" or "axial", for each mode. With
        $n = 0$ these are called breathing, torsion and umbrella.
    - `direction`: shares of the energy of radial, tangential and axial motion,
        shape `[mode, 3]` [-].
    - `spectrum`: share of the energy by nodal diameter, shape `[mode, n]` [-]. What a row lacks
        to one fits no $n$ up to its end.
    - `covered`: share of the weight that the spectrum was taken from [-].
    """

    diameter: np.ndarray
    circle: np.ndarray
    share: np.ndarray
    kind: tuple[str, ...]
    direction: np.ndarray
    spectrum: np.ndarray
    covered: float


@dataclass(frozen=True)
class Family:
    """Modes of one kind and one number of nodal circles: a line of frequency against diameter.

    **Fields:**

    - `kind`: "radial", "tangential" or "axial".
    - `circle`: nodal circles [-].
    - `modes`: which modes, by nodal diameter, then frequency, shape `[member]`.
    - `diameter`: their nodal diameters, shape `[member]` [-].
    - `frequency`: their frequencies, shape `[member]` [as given].
    """

    kind: str
    circle: int
    modes: np.ndarray
    diameter: np.ndarray
    frequency: np.ndarray


@dataclass(frozen=True)
class _Group:
    """Nodes fitted together: a ring, or scattered nodes with slopes along radius and height.

    `terms` is `[node, 1]` or `[node, 3]`: one, and scaled offsets from `place`.
    """

    nodes: np.ndarray
    place: np.ndarray
    terms: np.ndarray
    carries: int


def identify(
    points: np.ndarray, shapes: np.ndarray, *, weights: np.ndarray | None = None, most: int = 20
) -> NodalPattern:
    r"""Nodal diameters, nodal circles and direction of mode shapes.

    Nodes of equal radius and height form rings; scattered ones are grouped by radius and height,
    with slopes. In each group harmonics $0 \dots$ `most` of the cylindrical components are fitted
    by least squares. A group carries $n$ if no gap between neighbouring angles reaches $\pi/n$
    (on $N$ even nodes $n < N/2$; Groechenig, Math. Comp. 59, 1992). The spectrum ends at what a
    third of the weight carries; groups that carry less, such as those that holes interrupt, are
    left out. On $N$ even nodes $N - n$ looks like $n$: a mode beyond the end may appear below it.

    **Nodal circles** are changes of sign along the radius of the component that gives the mode
    its `kind`: of axial motion for web modes, as in plates; of radial or tangential motion for
    modes in the plane, so that a rim in torsion against its hub has one. The sign is that of the
    harmonic of most energy at the phase of most motion, averaged over the height within the
    toothed face, which is as wide as the nodes beyond 95% of the largest radius. Radii that move
    less than 5% of the largest amplitude are passed over. So the lowest umbrella of a free disc
    has one circle, and its lowest mode of two diameters none. Where `share` is small, modes have
    no clear numbers.

    **Arguments:**

    - `points`: nodes; z is the axis, shape `[node, 3]` [m].
    - `shapes`: displacements, shape `[mode, node, 3]` [any unit].
    - `weights`: weight of each node, such as the diagonal of the mass matrix, shape `[node]` [any
        unit]; not its row sums, which are negative at corners of 20-node bricks. None: all equal.
    - `most`: largest $n$ looked for [-].

    **Returns:**

    The pattern of every mode.

    **Raises:**

    - `BodyError` if shapes or weights do not fit the nodes, if a mode does not move, or if the
        nodes carry no harmonic.
    """
    weights = np.ones(len(points)) if weights is None else np.asarray(weights)
    _check_weights(points, shapes, weights)
    angle = np.arctan2(points[:, 1], points[:, 0])
    motion = _cylindrical(angle, shapes)
    direction = np.einsum("i,icm->mc", weights, motion**2)
    total = direction.sum(axis=1, keepdims=True)
    require(np.all(total > 0), "Every mode must move, {count} do not.", count=np.sum(~(total > 0)))
    direction /= total
    # Rounded, since a body that moves sideways does so by halves.
    kind = np.round(direction, 6).argmax(axis=1)

    groups, limit = _groups(points, angle, weights, most)
    require(
        limit > 0,
        "Nodes with a third of the weight must stand around z closely enough to show one nodal "
        "diameter, those given do not. Check that z is the axis, and give more nodes.",
    )
    fits = [
        _fit(group, angle[group.nodes], motion[group.nodes], weights[group.nodes], limit)
        for group in groups
    ]
    energy = np.sum([energy for _, energy in fits], axis=0)
    spectrum = (energy / energy.sum(axis=1, keepdims=True))[:, :-1]
    diameter = spectrum.argmax(axis=1)
    picked = [wave[0, diameter, kind, np.arange(len(shapes))] for wave, _ in fits]
    return NodalPattern(
        diameter=diameter,
        circle=_circles(groups, picked, points, weights),
        share=spectrum.max(axis=1),
        kind=tuple(KINDS[k] for k in kind),
        direction=direction,
        spectrum=spectrum,
        covered=float(_weight(groups, weights).sum() / weights.sum()),
    )


def _check_weights(points: np.ndarray, shapes: np.ndarray, weights: np.ndarray) -> None:
    require(
        shapes.ndim == 3 and shapes.shape[1:] == points.shape and weights.shape == points.shape[:1],
        "Shapes must be [mode, {nodes}, 3] and weights [{nodes}] on {nodes} nodes, got {shapes} "
        "and {weights}.",
        nodes=len(points),
        shapes=list(shapes.shape),
        weights=list(weights.shape),
    )
    require(
        weights.min() >= 0,
        "Weights must not be negative, got {got:.3g}. Give the diagonal of the mass matrix, not "
        "its row sums.",
        got=weights.min(),
    )


def families(pattern: NodalPattern, frequency: np.ndarray) -> tuple[Family, ...]:
    """Modes by kind and nodal circles, for frequency against nodal diameter.

    **Arguments:**

    - `pattern`: of the modes.
    - `frequency`: of every mode, shape `[mode]` [any unit].

    **Returns:**

    The families: axial, tangential, radial; of each, those of fewer circles first.
    """
    order = np.lexsort((frequency, pattern.diameter))
    names = [(pattern.kind[mode], int(pattern.circle[mode])) for mode in order]
    found = []
    for name in sorted(set(names), key=lambda name: (-KINDS.index(name[0]), name[1])):
        modes = order[[each == name for each in names]]
        found.append(Family(*name, modes, pattern.diameter[modes], frequency[modes]))
    return tuple(found)


def expected_split(diameter: int, holes: int) -> bool:
    """Whether a ring of equal holes gives the two modes of a pair different frequencies.

    Turned by the holes' pitch, or mirrored, the body is the same: its group is C_hv. The pair
    cos, sin of n belongs to a two-dimensional representation of it, and stays a pair, unless 2n
    is a multiple of the number of holes h. Then it falls into two one-dimensional ones (A1 + A2,
    or B1 + B2 if n is an odd multiple of h/2): one mode has antinodes at the holes, the other
    nodes, and nothing makes their frequencies equal. Without the mirror the same n split. (Perrin
    and Charnley, J. Sound Vib. 31, 1973; Thomas, Int. J. Numer. Meth. Eng. 14, 1979.)

    **Arguments:**

    - `diameter`: $n$ [-]; n = 0 is no pair.
    - `holes`: number of equal holes, 0 if none; of several rings, the greatest common divisor.

    **Returns:**

    True if the pair splits.
    """
    return diameter > 0 and holes > 0 and 2 * diameter % holes == 0


def symmetry_splitting(
    pattern: NodalPattern, frequency: np.ndarray
) -> tuple[tuple[int, int, float], ...]:
    """The two modes of each pair, and how far apart their frequencies are.

    Modes of one family and one nodal diameter are taken two by two, from the lowest.

    **Arguments:**

    - `pattern`: of the modes.
    - `frequency`: of every mode, shape `[mode]` [any unit].

    **Returns:**

    For every pair: its two modes, and the difference of their frequencies over the mean [-].
    """
    found = []
    for family in families(pattern, frequency):
        for n in np.unique(family.diameter[family.diameter > 0]):
            modes = family.modes[family.diameter == n]
            for i, j in zip(modes[::2], modes[1::2], strict=False):
                mean = max((frequency[i] + frequency[j]) / 2, np.finfo(float).tiny)
                found.append((int(i), int(j), float((frequency[j] - frequency[i]) / mean)))
    return tuple(found)


def _cylindrical(angle: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Radial, tangential and axial displacement, shape `[node, 3, mode]`."""
    x, y, z = np.moveaxis(shapes, -1, 0)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([x * cos + y * sin, y * cos - x * sin, z]).transpose(2, 0, 1)


def _groups(
    points: np.ndarray, angle: np.ndarray, weights: np.ndarray, most: int
) -> tuple[list[_Group], int]:
    """The groups that carry what can be carried, and how much that is."""
    place = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
    key = np.round(place / (_RING * place[:, 0].max())).astype(int)
    _, ring, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    rings = np.split(np.argsort(ring.ravel(), kind="stable"), np.cumsum(count)[:-1])
    rings = [_group(ring, place, angle, slopes=False) for ring in rings if len(ring) > 2]
    # A grid repeated around the axis has rings everywhere, of few nodes each: there scattered
    # nodes tell more. Otherwise rings do, since slopes are not exact.
    least = sorted({_limit(rings, weights, most), most})
    found = [_with_scattered(rings, each, place, angle, weights, most) for each in least]
    return max(found, key=lambda each: each[1])


def _with_scattered(
    rings: list[_Group],
    least: int,
    place: np.ndarray,
    angle: np.ndarray,
    weights: np.ndarray,
    most: int,
) -> tuple[list[_Group], int]:
    """Rings that carry `least` or more, and groups of all other nodes; those that carry enough."""
    rings = [ring for ring in rings if ring.carries >= max(least, 1)]
    loose = np.ones(len(place), dtype=bool)
    loose[[node for ring in rings for node in ring.nodes]] = False
    size = min(int(3 * _SPARE * (2 * most + 1)), loose.sum() // _LEAVES)
    leaves = _leaves(np.flatnonzero(loose), place, size) if size else []
    groups = rings + [_group(leaf, place, angle, slopes=True) for leaf in leaves]
    limit = _limit(groups, weights, most)
    return [group for group in groups if group.carries >= limit], limit


def _group(nodes: np.ndarray, place: np.ndarray, angle: np.ndarray, *, slopes: bool) -> _Group:
    middle = place[nodes].mean(axis=0)
    spread = np.maximum(place[nodes].std(axis=0), _RING * place[:, 0].max())
    offset = (place[nodes] - middle) / spread
    terms = np.column_stack([np.ones(len(nodes)), offset]) if slopes else np.ones((len(nodes), 1))
    enough = len(nodes) / (3 * _SPARE) if slopes else len(nodes)
    carries = min(np.ceil(np.pi / _gap(angle[nodes]) - 1e-6) - 1, (enough - 1) // 2)
    return _Group(nodes, middle, terms, int(carries))


def _gap(angle: np.ndarray) -> float:
    """Largest angle without a node [rad]."""
    ordered = np.sort(angle)
    return np.diff(ordered, append=ordered[0] + 2 * np.pi).max()


def _leaves(nodes: np.ndarray, place: np.ndarray, size: int) -> list[np.ndarray]:
    """Halve along radius or height, whichever is longer, as long as halves hold `size` nodes."""
    axis = np.ptp(place[nodes], axis=0).argmax()
    # Nodes of one radius or height stay together, whatever their rounding.
    middle = np.median(place[nodes, axis]) + _RING * place[:, 0].max()
    below = place[nodes, axis] <= middle
    if min(below.sum(), (~below).sum()) < size:
        return [nodes]
    return _leaves(nodes[below], place, size) + _leaves(nodes[~below], place, size)


def _limit(groups: list[_Group], weights: np.ndarray, most: int) -> int:
    """The largest harmonic that groups with a third of the weight carry; 0 if none."""
    groups = sorted(groups, key=lambda group: -group.carries)
    enough = np.searchsorted(np.cumsum(_weight(groups, weights)), weights.sum() / 3)
    return min(groups[enough].carries, most) if enough < len(groups) else 0


def _weight(groups: list[_Group], weights: np.ndarray) -> np.ndarray:
    return np.array([weights[group.nodes].sum() for group in groups])


def _fit(
    group: _Group, angle: np.ndarray, motion: np.ndarray, weights: np.ndarray, limit: int
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes a + ib of a cos + b sin, `[term, n, component, mode]`; energies by n, averaged
    over all phases, and of what does not fit, `[mode, n + 1]`.
    """
    n = np.arange(limit + 1)
    around = np.hstack([np.cos(np.outer(angle, n)), np.sin(np.outer(angle, n[1:]))])
    design = (group.terms[:, :, None] * around[:, None, :]).reshape(len(angle), -1)
    right = motion.reshape(len(angle), -1)
    inverse = np.linalg.pinv(design.T @ design, rcond=_FAINT, hermitian=True)
    fitted = inverse @ (design.T @ right)
    missed = np.einsum("i,icm->m", weights, (right - design @ fitted).reshape(motion.shape) ** 2)
    fitted = fitted.reshape(group.terms.shape[1], -1, *motion.shape[1:])
    wave = fitted[:, : limit + 1].astype(complex)
    wave[:, 1:] += 1j * fitted[:, limit + 1 :]
    moments = group.terms.T @ (weights[:, None] * group.terms)
    energy = np.einsum("tncm,tu,uncm->mn", wave.conj(), moments, wave, optimize=True).real
    return wave, np.column_stack([energy * np.where(n > 0, 0.5, 1.0), missed])


def _circles(
    groups: list[_Group], waves: list[np.ndarray], points: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Changes of sign along the radius of every group's `[mode]`, see `identify`."""
    radius = np.hypot(points[:, 0], points[:, 1])
    same = _RING * radius.max()
    face = points[radius >= _FACE * radius.max(), 2]
    middle, height = np.array([group.place for group in groups]).T
    within = (face.min() - same <= height) & (height <= face.max() + same)
    # The radii of the groups, and the groups that reach there.
    level = np.unique(middle[within])[:, None]
    lowest = np.array([radius[group.nodes].min() for group in groups]) - same
    highest = np.array([radius[group.nodes].max() for group in groups]) + same
    part = within * (lowest <= level) * (level <= highest)
    part = part * _weight(groups, weights)
    mass = np.maximum(part.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    amplitude = part @ np.array(waves) / mass
    # A standing wave moves along a line through zero: turn it onto the real axis.
    signed = (amplitude * np.exp(-0.5j * np.angle((amplitude**2).sum(axis=0)))).real
    # Motion that is opposite at both sides of the face has no mean over it, but for rounding.
    whole = _SILENT * abs(np.array(waves)).max(axis=0)
    loud = abs(signed) > np.maximum(_QUIET * abs(signed).max(axis=0, initial=0.0), whole)
    signs = [np.sign(each[heard]) for each, heard in zip(signed.T, loud.T, strict=True)]
    return np.array([np.count_nonzero(np.diff(sign)) for sign in signs])
