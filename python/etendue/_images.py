"""Pictures: files, tone mapping, comparison."""

import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from etendue import _etendue
from etendue._errors import ImageError

Array = NDArray[np.float32]
"""A picture: (height, width, channels)."""


def _planes(array: ArrayLike, what: str, channels: tuple[int, ...] | None = None) -> Array:
    """Return the array as (height, width, channels) of `float32`."""
    planes = np.asarray(array, dtype=np.float32)
    if planes.ndim == 2:
        planes = planes[:, :, np.newaxis]
    if planes.ndim != 3 or planes.size == 0 or (channels is not None and planes.shape[2] not in channels):
        wanted = "channels" if channels is None else " or ".join(map(str, channels))
        raise ImageError(f"{what} has shape {np.shape(array)}, not (height, width, {wanted})")
    return planes


def read_layers(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Read a picture file with all its channels: EXR, HDR, PNG, JPEG, WebP, TIFF, BMP, TGA, GIF.

    Args:
        path: The file. Its extension tells the format only where the content does not.

    Returns:
        The layers by name, `float32` of shape (height, width, channels): `rgb`, `alpha`, and those of
        an EXR file under the names that `Scene.render` gives them. Values are linear: integer files are decoded
        from sRGB.

    Raises:
        OSError: The file cannot be opened.
        ImageError: The file is damaged or too large.
        UnsupportedError: The format is not read.
    """
    return _etendue.read_layers(path)


def read_image(path: str | os.PathLike[str]) -> Array:
    """Read the picture of a file.

    Args:
        path: The file, of a format that `read_layers` reads.

    Returns:
        Linear Rec. 709 values, `float32` of shape (height, width, 3). A gray picture has three equal channels.

    Raises:
        OSError: The file cannot be opened.
        ImageError: The file is damaged, too large, or has neither color nor gray values.
        UnsupportedError: The format is not read.
    """
    layers = read_layers(path)
    rgb = layers.get("rgb", layers.get("Y"))
    if rgb is None and len(layers) == 1:
        rgb = next(iter(layers.values()))
    if rgb is None or rgb.shape[2] not in (1, 3):
        raise ImageError(f"{os.fspath(path)}: no channels R, G, B (there are {', '.join(layers)})")
    return rgb if rgb.shape[2] == 3 else np.repeat(rgb, 3, axis=2)


def write_image(
    path: str | os.PathLike[str],
    image: ArrayLike | Mapping[str, ArrayLike],
    *,
    tonemap: str = "standard",
    exposure: float = 0.0,
) -> None:
    """Write a picture: EXR (all channels), HDR, PFM (linear), PNG, JPEG (tone mapped).

    The file appears whole or not at all.

    Args:
        path: The file; its extension is the format.
        image: Linear values of shape (height, width) or (height, width, 1, 3 or 4), or layers by name as
            `Scene.render(aovs=…)` returns them. Layers other than `rgb` are written to EXR files only.
        tonemap: For PNG and JPEG: `standard` (clipped at 1), `filmic`, `aces` or `agx`.
        exposure: For PNG and JPEG, in stops.

    Raises:
        OSError: The file cannot be written.
        ImageError: The shapes do not fit.
        SettingError: There is no such tone mapping.
        UnsupportedError: The format is not written.
    """
    if isinstance(image, Mapping):
        layers = [(name, _planes(array, f"layer {name!r}")) for name, array in image.items()]
        if not layers:
            raise ImageError("there is no layer")
    else:
        layers = [("rgb", _planes(image, "the picture", (1, 3, 4)))]
    _etendue.write_layers(path, layers, tonemap, exposure)


def tonemap(image: ArrayLike, operator: str = "standard", *, exposure: float = 0.0) -> Array:
    """Turn a linear picture into display values.

    Args:
        image: Linear Rec. 709 values of shape (height, width, 3).
        operator: `standard` (clipped at 1), `filmic`, `aces` or `agx`.
        exposure: In stops: each doubles the light.

    Returns:
        Values in [0, 1], encoded for sRGB displays, `float32` of shape (height, width, 3).

    Raises:
        ImageError: The shape does not fit.
        SettingError: There is no such operator.
    """
    return _etendue.tonemap(_planes(image, "the picture", (3,)), operator, exposure)


def compare(image: ArrayLike, reference: ArrayLike, *, hdr: bool = True) -> dict[str, float | None]:
    """Measure how much a picture differs from a reference.

    Args:
        image: Linear Rec. 709 values of shape (height, width, 3).
        reference: The same.
        hdr: Take HDR-FLIP over several exposures; otherwise FLIP sees both pictures clipped at 1.

    Returns:
        The figures: `mse`, `relmse`, `relmse_trimmed` (without the worst 0.1% of the pixels), `mae`, `psnr` in dB,
        `ssim` (None for pictures with a side below 11 pixels), `flip`, `mean` (the largest |ratio − 1| of the means of R, G
        and B), `max` (the largest difference), and `nonfinite` (how many values are NaN or infinite; they count as 0).

    Raises:
        ImageError: The shapes do not fit.
    """
    return _etendue.compare(_planes(image, "the picture", (3,)), _planes(reference, "the reference", (3,)), hdr)


def flip_map(image: ArrayLike, reference: ArrayLike, *, hdr: bool = True) -> Array:
    """Measure the visible difference of each pixel.

    Args:
        image: Linear Rec. 709 values of shape (height, width, 3).
        reference: The same.
        hdr: Take HDR-FLIP over several exposures; otherwise FLIP sees both pictures clipped at 1.

    Returns:
        FLIP in [0, 1], `float32` of shape (height, width, 1).

    Raises:
        ImageError: The shapes do not fit.
    """
    return _etendue.flip_map(_planes(image, "the picture", (3,)), _planes(reference, "the reference", (3,)), hdr)
