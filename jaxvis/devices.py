"""Several JAX devices that shade one image: blocks of pixels are dealt to them in turn."""

import contextlib
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import Any, TypeVar

import jax
from jax.core import Tracer

T = TypeVar("T")

Dealer = Callable[[int], contextlib.AbstractContextManager]
"""Block number -> a context in which what is computed is computed on that block's device."""

_DEVICES: ContextVar[tuple[Any, ...]] = ContextVar("devices", default=())


@contextlib.contextmanager
def on_devices(devices: Sequence[Any] | None = None) -> Iterator[None]:
    """Within it, the blocks of pixels of every image are shaded by several devices.

        with jaxvis.on_devices():  # all that JAX has
            image = method.shade(visibility, light, surface, key=key)

    The same compiled programs meet the same blocks, one after another on one device or on several
    at once: the image is the same, bit for bit, where devices are alike. Rays are traced by the
    host all the same. Blocks have thousands of pixels: small images have fewer than devices.
    Functions that JAX transforms (``grad``, ``jit``, ``vmap``) stay on the default device.

    Raises:
        ValueError: no device is given.
    """
    chosen = tuple(jax.devices() if devices is None else devices)
    if not chosen:
        raise ValueError("give at least one device")
    token = _DEVICES.set(chosen)
    try:
        yield
    finally:
        _DEVICES.reset(token)


def device_count() -> int:
    """Devices that share images; 0 where all is done by the default one."""
    return len(_DEVICES.get())


def dealer() -> Dealer:
    """Of the devices in use. To be asked for by the thread that shades, for all its threads."""
    devices = _DEVICES.get()
    if not devices:
        return lambda block: contextlib.nullcontext()
    return lambda block: jax.default_device(devices[block % len(devices)])


def nearby(tree: T) -> T:
    """The tree's arrays on the device that :func:`dealer` chose here.

    JAX would take them there by itself, for every call: of large tables this keeps a copy on each
    device for as long as the tables are there.
    """
    device: Any = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    if not isinstance(device, jax.Device):
        return tree
    return jax.tree.map(lambda leaf: _copy(leaf, device), tree)


_COPIES: dict[tuple[int, Any], jax.Array] = {}
_COPYING = threading.Lock()


def _copy(leaf: Any, device: Any) -> Any:
    if not isinstance(leaf, jax.Array) or isinstance(leaf, Tracer) or leaf.devices() == {device}:
        return leaf
    key = id(leaf), device
    with _COPYING:
        if key not in _COPIES:
            _COPIES[key] = jax.device_put(leaf, device)
            weakref.finalize(leaf, _COPIES.pop, key, None)
        return _COPIES[key]
