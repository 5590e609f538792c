"""Public names of `jaxgear.explore`."""

from ._server import Explorer as Explorer
