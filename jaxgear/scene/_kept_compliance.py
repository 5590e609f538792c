"""Compliances that take long to find, from the cache of bodies."""

from collections.abc import Callable, Mapping

import numpy as np

from fem_prep import Compliance, cached, key_of, read_compliance, write_compliance


def kept_compliance(made_from: Mapping[str, object], find: Callable[[], np.ndarray]) -> np.ndarray:
    """A compliance from the cache, or found and kept there.

    **Arguments:**

    - `made_from`: all that it follows from, as of `fem_prep.key_of`.
    - `find`: works it out.

    **Returns:**

    What `find` gives, or gave [SI].
    """
    build = lambda: Compliance(find())
    return cached(key_of(made_from), build, (read_compliance, write_compliance))[0].matrix
