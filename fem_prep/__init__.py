"""Condensed models of flexible gear bodies, prepared offline.

Will hold the finite element grid of a gear's web, its assembly, and its condensation on the
rim and the bearing seats into the one file that `jaxgear` reads. This version has none of it:
every gear body is rigid.
"""
