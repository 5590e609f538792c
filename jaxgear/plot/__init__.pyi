"""Public names of `jaxgear.plot`."""

from ._atlas import animations as animations
from ._atlas import pictures as pictures
from ._picture import Animation as Animation
from ._picture import Picture as Picture
from ._picture import columns as columns
