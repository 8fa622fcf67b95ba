"""Light-probe files written by hand, byte by byte, so that readers are not tested on themselves."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio


def write_pfm(path: Path, pixels: np.ndarray, *, big_endian: bool = False) -> Path:
    """Bottom row first, as the format says (Debevec's description of PFM)."""
    height, width = pixels.shape[:2]
    kind = b"Pf" if pixels.ndim == 2 else b"PF"
    scale = b"1.0" if big_endian else b"-1.0"
    data = pixels[::-1].astype(">f4" if big_endian else "<f4").tobytes()
    path.write_bytes(b"%s\n%d %d\n%s\n" % (kind, width, height, scale) + data)
    return path


def write_hdr(path: Path, pixels: np.ndarray, order: str = "-Y {h} +X {w}") -> Path:
    """Radiance RGBE without run lengths; ``order`` is the resolution line."""
    height, width = pixels.shape[:2]
    exponent = np.ceil(np.log2(pixels.max(axis=-1, keepdims=True) * 1.01 + 1e-30))
    mantissa = np.floor(pixels / 2.0**exponent * 256.0)
    data = np.concatenate([mantissa, exponent + 128.0], axis=-1).astype(np.uint8).tobytes()
    line = order.format(h=height, w=width)
    path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{line}\n".encode() + data)
    return path


def write_exr(path: Path, pixels: np.ndarray, channels: tuple[str, ...] = ("R", "G", "B")) -> Path:
    pixels = pixels.reshape(*pixels.shape[:2], -1).astype(np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = channels
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(pixels))
    output.close()
    return path


def gradient(height: int, width: int) -> np.ndarray:
    """Different in every texel, and exact in RGBE."""
    row, column = np.arange(height)[:, None], np.arange(width)
    red = 1.0 + (row * width + column) % 64
    return np.stack([red, 0.0 * red + row + 1.0, 0.0 * red + column + 1.0], axis=-1)
