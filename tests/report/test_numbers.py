"""Numbers as text."""

import pytest

from jaxvis.report import numbers


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0 s"),
        (4.2e-6, "4.20 µs"),
        (0.00123, "1.23 ms"),
        (0.9996, "1.00 s"),
        (0.0123, "12.3 ms"),
        (1.234, "1.23 s"),
        (59.94, "59.9 s"),
        (125.4, "2 min 5 s"),
    ],
)
def test_seconds(value, text):
    assert numbers.seconds(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0, "0"),
        (999, "999"),
        (1000, "1.00 k"),
        (12_345_678, "12.3 M"),
        (10**15, "1000 T"),
    ],
)
def test_count(value, text):
    assert numbers.count(value) == text


def test_memory_is_binary():
    assert numbers.memory(1023) == "1.00 KiB"
    assert numbers.memory(512) == "512 B"
    assert numbers.memory(3 * 2**20) == "3.00 MiB"


def test_decibels_of_equal_and_failed_images():
    assert numbers.decibels({"psnr_db": None, "rmse": 0.0}) == "∞"
    assert numbers.decibels({"psnr_db": None, "rmse": None}) == "–"
    assert numbers.decibels({"psnr_db": 31.456, "rmse": 0.1}) == "31.46"
