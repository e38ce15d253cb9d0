import importlib
import pkgutil

from numba.core.registry import CPUDispatcher

from services.mocap import fit
from services.mocap.fit.warm_up import warm_up


def test_after_warming_up_a_fit_has_nothing_left_to_compile() -> None:
    warm_up()
    compiled = {}
    for module in pkgutil.iter_modules(fit.__path__, f"{fit.__name__}."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, CPUDispatcher) and value.py_func.__module__.startswith(fit.__name__):
                compiled[value.py_func.__qualname__] = bool(value.signatures)
    assert len(compiled) > 5
    assert all(compiled.values()), compiled
