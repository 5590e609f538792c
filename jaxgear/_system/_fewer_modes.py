"""A condensed body on fewer of its modes."""

import dataclasses

from jaxgear._system._flexible import FlexibleBody


def fewer_modes(body: FlexibleBody, count: int) -> FlexibleBody:
    """A body with its lowest modes only; what they leave deflects statically.

    **Arguments:**

    - `body`: that vibrates.
    - `count`: number of modes, one less where a pair would be parted; 0 are all.

    **Returns:**

    The body.
    """
    modes = body.modes
    assert modes is not None
    if count == 0 or count >= modes.square.size:
        return body
    count -= modes.waves[count] < 0
    size = modes.mass.shape[0] - modes.square.size + count
    cut = lambda matrix: None if matrix is None else matrix[:size, :size]
    return dataclasses.replace(
        body,
        modes=dataclasses.replace(
            modes,
            square=modes.square[:count],
            rows=modes.rows[..., :count],
            load=modes.load[:count],
            mass=cut(modes.mass),
            turning=cut(modes.turning),
            coriolis=cut(modes.coriolis),
            softening=cut(modes.softening),
            waves=modes.waves[:count],
            diameters=modes.diameters[:count],
        ),
    )
