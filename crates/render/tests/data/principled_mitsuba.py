"""Makes principled_mitsuba.json: values of Mitsuba 3's `principled` and `principledthin` BSDFs.

    pip install mitsuba==3.9.1
    python principled_mitsuba.py > principled_mitsuba.json

Every case lists the parameters and the values f * |cos| (RGB) for all pairs of the directions below, `wo` (Mitsuba's
`si.wi`) in the outer loop. Radiance transport.
"""

import json
import math

import mitsuba as mi

mi.set_variant("scalar_rgb")


def direction(theta_deg, phi_deg):
    t, p = math.radians(theta_deg), math.radians(phi_deg)
    return [round(x, 7) for x in (math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t))]


WO = [direction(5, 20), direction(40, 70), direction(75, 200), direction(120, 30), direction(160, 300)]
WI = [direction(t, p) for t, p in ((8, 200), (35, 250), (42, 248), (60, 20), (85, 120), (100, 10), (130, 210), (135, 252), (172, 120))]

COLOR = [0.8, 0.35, 0.1]
SOLID = [
    {},
    {"roughness": 0.05},
    {"roughness": 1.0, "specular": 0.0},
    {"roughness": 0.3, "metallic": 1.0},
    {"roughness": 0.3, "metallic": 0.4, "spec_tint": 0.7},
    {"roughness": 0.4, "anisotropic": 0.8, "metallic": 0.9},
    {"roughness": 0.25, "spec_trans": 1.0, "eta": 1.5},
    {"roughness": 0.5, "spec_trans": 1.0, "eta": 1.33, "anisotropic": 0.6, "spec_tint": 0.5},
    {"roughness": 0.6, "spec_trans": 0.5, "eta": 2.0, "metallic": 0.3},
    {"sheen": 1.0, "specular": 0.2},
    {"sheen": 0.7, "sheen_tint": 0.6, "metallic": 0.5},
    {"sheen": 0.7, "sheen_tint": 0.6, "spec_trans": 0.5},
    {"flatness": 1.0, "roughness": 0.8},
    {"flatness": 0.5, "roughness": 0.2},
    {"clearcoat": 1.0, "clearcoat_gloss": 0.0},
    {"clearcoat": 0.6, "clearcoat_gloss": 0.9, "metallic": 0.6},
    {"clearcoat": 1.0, "clearcoat_gloss": 0.5, "spec_trans": 0.8, "roughness": 0.3},
    {"roughness": 0.35, "anisotropic": 0.5, "metallic": 0.2, "spec_trans": 0.3, "eta": 1.6, "spec_tint": 0.4, "sheen": 0.5,
     "sheen_tint": 0.5, "flatness": 0.3, "clearcoat": 0.8, "clearcoat_gloss": 0.3},
]
THIN = [
    {},
    {"roughness": 0.1, "spec_trans": 1.0, "eta": 1.5},
    {"roughness": 0.4, "spec_trans": 0.6, "eta": 1.8, "spec_tint": 0.5, "anisotropic": 0.7},
    {"diff_trans": 1.0},
    {"diff_trans": 2.0, "roughness": 0.8},
    {"diff_trans": 0.6, "flatness": 0.7, "sheen": 0.8, "sheen_tint": 0.4},
    {"roughness": 0.5, "spec_trans": 0.3, "eta": 1.4, "spec_tint": 0.3, "anisotropic": 0.2, "diff_trans": 1.2, "flatness": 0.4,
     "sheen": 0.5, "sheen_tint": 1.0},
]


def values(plugin, params):
    bsdf = mi.load_dict({"type": plugin, "base_color": {"type": "rgb", "value": COLOR}, **params})
    si = mi.SurfaceInteraction3f()
    si.t = 1.0
    out = []
    for wo in WO:
        si.wi = wo
        for wi in WI:
            out.append([float(f"{x:.6g}") for x in bsdf.eval(mi.BSDFContext(), si, wi)])
    return out


cases = [{"thin": thin, "params": p, "values": values("principledthin" if thin else "principled", p)}
         for thin, group in ((False, SOLID), (True, THIN)) for p in group]
print('{"mitsuba": "%s", "base_color": %s, "wo": %s,\n "wi": %s,\n "cases": [' % (mi.__version__, COLOR, WO, WI))
print(",\n".join(json.dumps(c, separators=(",", ":")) for c in cases))
print("]}")
