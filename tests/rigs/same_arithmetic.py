"""A plug-in of pytest that is loaded before NumPy: its matrix products round alike on all x86 CPUs.

OpenBLAS chooses its kernels by the processor, and they differ in the last bit of a product. Tests
render pictures with such products, and a marker whose cells are smaller than a pixel is read in one
machine's picture and not in another's: a test of it passed on one kind of machine and failed on the
next. Recordings that older versions made are tracked again to the bit with kernels that fuse
multiplication and addition, as those of nearly all processors today.
"""

import os
import sys
from pathlib import Path

CPU = Path("/proc/cpuinfo")

if CPU.exists() and {"avx2", "fma"} <= set(CPU.read_text().split()):
    assert "numpy" not in sys.modules, "it is too late to choose"
    os.environ["OPENBLAS_CORETYPE"] = "HASWELL"
