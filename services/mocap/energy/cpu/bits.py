"""What processors do with a word in one instruction and Numba has no name for."""

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic


def _lowest_bit(_context: Any, _word: Any) -> Any:
    def generate(_: Any, builder: ir.IRBuilder, __: Any, arguments: Any) -> Any:
        zero_is_undefined = ir.Constant(ir.IntType(1), 1)
        return builder.cttz(arguments[0], zero_is_undefined)

    return numba.uint64(numba.uint64), generate


lowest_bit = cast(Callable[[np.uint64], np.uint64], intrinsic(_lowest_bit))
"""The number of the lowest bit that is set; one has to be. For compiled code only."""
