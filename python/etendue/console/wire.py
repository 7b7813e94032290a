"""Pictures on their way to a browser: one layer with its numbers, not a finished picture.

The browser applies exposure and tone mapping by itself and shows the values of pixels, so it gets numbers: a header in JSON
behind its length (4 bytes, little endian), padded to a multiple of 8, then rows of pixels from the top, little endian,
half precision for colors and single precision where whole numbers or long distances count.
"""

import json
import struct
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

MEDIA_TYPE = "application/x-etendue-layer"

_EXACT = frozenset({"depth", "position", "object", "material", "samples", "uv"})
"""Layers that half precision would damage."""

_LARGEST_HALF = 65504.0


def encode_layer(name: str, layer: NDArray[np.float32], meta: Mapping[str, object]) -> bytes:
    """Return a layer as the browser reads it.

    Args:
        name: Name of the layer, such as `rgb`.
        layer: Shape (height, width, channels).
        meta: What the header says beside `layer`, `width`, `height`, `channels` and `dtype`; must fit into JSON.
    """
    height, width, channels = layer.shape
    if name in _EXACT or name.startswith("cryptomatte"):
        data, dtype = np.ascontiguousarray(layer, dtype="<f4"), "f4"
    else:
        # Finite numbers stay finite; what is infinite or no number is shown as such.
        finite = np.where(np.isfinite(layer), np.clip(layer, -_LARGEST_HALF, _LARGEST_HALF), layer)
        data, dtype = np.ascontiguousarray(finite, dtype="<f2"), "f2"
    header = {**meta, "layer": name, "width": width, "height": height, "channels": channels, "dtype": dtype}
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(4 + len(text)) % 8)
    return struct.pack("<I", len(text)) + text + data.tobytes()


def decode_layer(message: bytes) -> tuple[dict[str, object], NDArray[np.float32]]:
    """Return header and layer of `encode_layer`, the layer as `float32`: for tests and scripts.

    Raises:
        ValueError: The message is cut short or is none of ours.
    """
    if len(message) < 4:
        raise ValueError("the message has no header")
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    shape = (header["height"], header["width"], header["channels"])
    data = np.frombuffer(message, dtype=f"<{header['dtype']}", offset=4 + length)
    return header, data.reshape(shape).astype(np.float32)
