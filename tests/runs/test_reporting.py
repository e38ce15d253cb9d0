"""Warnings of the library are collected once."""

import logging

import pytest

from services.runs.reporting import kept_warnings

log = logging.getLogger("services.somewhere")


def test_the_innermost_collects_and_the_outer_one_goes_on_after_it() -> None:
    with kept_warnings() as outer:
        log.warning("one")
        with pytest.raises(ValueError, match="inside"), kept_warnings() as inner:
            log.warning("two")
            raise ValueError("inside")
        log.warning("three")
    log.info("four")
    assert (outer, inner) == (["one", "three"], ["two"])
