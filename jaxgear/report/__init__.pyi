"""Public names of `jaxgear.report`."""

from ._page import report as report
