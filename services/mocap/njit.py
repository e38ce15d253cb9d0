"""How compiled code is declared where taking arrays apart would cost it most of its time."""

from collections.abc import Callable
from typing import TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def njit_without_refcounts(function: Function) -> Function:
    """Compile what loops over cameras, segments, outlines or voxels.

    To take an array out of a tuple, or a slice of one, otherwise counts it up and down again, which was a
    fifth to half of all the time that evaluations took. Such a function can make no arrays; those that it is
    given have to be held by who calls it, as Python does.
    """
    compiled: Function = numba.njit(  # type: ignore[call-overload]  # _nrt is not in its stubs
        cache=True, nogil=True, error_model="numpy", _nrt=False
    )(function)
    return compiled
