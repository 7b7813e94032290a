"""Etendue: a global-illumination renderer for the scene files you already have.

```python
import etendue

scene = etendue.load("scene.xml")
picture = scene.render(spp=64)  # numpy float32, (height, width, 3), linear
etendue.write_image("picture.png", picture)
```

Pictures are NumPy arrays of `float32` and shape (height, width, channels), row 0 at the top, with linear Rec. 709
values.
The same seed gives the same picture, bit for bit, with any number of threads.
"""

from etendue._errors import Error, Fault, ImageError, SceneError, SettingError, UnsupportedError
from etendue._etendue import Status, __version__
from etendue._images import compare, flip_map, read_image, read_layers, tonemap, write_image
from etendue._scene import Loss, Parameter, Scene, View, integrators, load, load_dict, load_string, parameters
from etendue._study import study
from etendue._transform import Transform

__all__ = [
    "Error",
    "Fault",
    "ImageError",
    "Loss",
    "Parameter",
    "Scene",
    "SceneError",
    "SettingError",
    "Status",
    "Transform",
    "UnsupportedError",
    "View",
    "__version__",
    "compare",
    "flip_map",
    "integrators",
    "load",
    "load_dict",
    "load_string",
    "parameters",
    "read_image",
    "read_layers",
    "study",
    "tonemap",
    "write_image",
]
