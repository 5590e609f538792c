"""The thesis of B. Guilbert (INSA Lyon, 2017), row by row: what it says and what jaxgear says.

`row.py` says what a row is, `chapter_*.py` hold them, the other files make the tables from which
rows are answered, `page.py` writes the page of findings.
"""

import os

# Before NumPy is imported: bodies take several times as long on threads that wait for each other.
for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
