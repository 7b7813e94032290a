"""Makes sun_table.rs: the sun's irradiance by turbidity and elevation, from Mitsuba 3's `sunsky` emitter (pip install mitsuba).

The numbers are those of the solar radiance data of Hosek and Wilkie 2013 ("Adding a Solar-Radiance Function to the
Hosek-Wilkie Skylight Model", doi:10.1109/MCG.2013.18), as linear Rec. 709 irradiance on a surface that faces the sun.
"""

import mitsuba as mi
import numpy as np

KNOTS = 25  # at elevation 90 degrees * (k / (KNOTS - 1))^3
APERTURE = np.deg2rad(0.5358)


def irradiance(turbidity, elevation):
    sun = [float(np.cos(elevation)), 0.0, float(np.sin(elevation))]
    emitter = mi.load_dict({"type": "sunsky", "sun_direction": sun, "turbidity": turbidity, "sky_scale": 0.0})
    si = mi.SurfaceInteraction3f()
    si.wi = -mi.Vector3f(*sun)
    return np.maximum(np.array(emitter.eval(si)), 0.0) * np.pi * np.sin(APERTURE / 2) ** 2


mi.set_variant("scalar_rgb")
print("//! The sun's irradiance, made by `sun_table.py` (Mitsuba %s): see there.\n" % mi.__version__)
print("/// W/m² in linear Rec. 709, by turbidity 1 to 10 and elevation 90°·(k / %d)³." % (KNOTS - 1))
print("#[rustfmt::skip]")
print("pub(super) const SUN_IRRADIANCE: [[[f32; 3]; %d]; 10] = [" % KNOTS)
for turbidity in range(1, 11):
    print("    [")
    for k in range(KNOTS):
        # The model has no values below 1 degree.
        elevation = max(90.0 * (k / (KNOTS - 1)) ** 3, 1.0)
        print("        [%.5f, %.5f, %.5f]," % tuple(irradiance(float(turbidity), np.deg2rad(elevation))))
    print("    ],")
print("];")
