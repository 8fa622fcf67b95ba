"""One image on several devices: the same bits. Devices are simulated, in a process of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis import devices
from jaxvis.devices import dealer, device_count, nearby, on_devices
from tests.shading_on_devices import PARAMETERS


@pytest.fixture(scope="module")
def shaded(own_caches):
    flags = "--xla_force_host_platform_device_count=3 --xla_cpu_use_fusion_emitters=false"
    settings = {"XLA_FLAGS": flags, "JAX_DISABLE_MOST_OPTIMIZATIONS": "true"}
    done = subprocess.run(
        [sys.executable, "-m", "tests.shading_on_devices"],
        env=os.environ | settings | {"JAX_PLATFORMS": "cpu"},
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", PARAMETERS)
def test_devices_share_an_image_and_change_no_bit(shaded, name):
    assert shaded["devices"] == 3
    found = shaded["methods"][name]
    assert found["mean"] > 0.1
    assert found["differ"] == 0
    assert len(found["blocks"]) >= 2, "one device did it all"
    assert max(found["blocks"].values()) <= 3 * min(found["blocks"].values())


def test_blocks_are_dealt_in_turn_while_it_is_asked_for(monkeypatch):
    given = []
    monkeypatch.setattr(jax, "default_device", lambda device: given.append(device))
    with dealer()(5):
        assert device_count() == 0
    with on_devices(["a", "b", "c"]):
        assert device_count() == 3
        deal = dealer()
    assert device_count() == 0
    for block in (0, 1, 2, 3, 7):
        deal(block)
    assert given == ["a", "b", "c", "a", "b"]


def test_all_devices_are_the_default():
    with on_devices():
        assert device_count() == len(jax.devices())
        with dealer()(0):
            assert (jnp.ones(3) + np.ones(3)).devices() == {jax.devices()[0]}
    with pytest.raises(ValueError, match="at least one device"), on_devices([]):
        pass


def test_tables_are_copied_once_and_let_go(monkeypatch):
    puts = []

    def put(leaf, device):
        puts.append(device)
        return np.array(leaf)

    monkeypatch.setattr(jax, "device_put", put)
    table = jnp.arange(5.0)
    monkeypatch.setattr(jax, "config", SimpleNamespace(jax_default_device="cpu"))
    assert nearby((table,))[0] is table
    other = SimpleNamespace(jax_default_device=jax.devices()[0])
    monkeypatch.setattr(jax, "config", other)
    assert nearby((table,))[0] is table  # it is there
    monkeypatch.setattr(jax, "Device", str)
    monkeypatch.setattr(jax, "config", SimpleNamespace(jax_default_device="elsewhere"))
    copies = [nearby({"table": table, "size": 3}) for _ in range(3)]
    assert puts == ["elsewhere"]
    assert [copy["size"] for copy in copies] == [3, 3, 3]
    np.testing.assert_array_equal(copies[2]["table"], table)
    kept = len(devices._COPIES)
    del table
    assert len(devices._COPIES) == kept - 1
