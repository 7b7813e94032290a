"""Makes bsdf_mitsuba.json: values and densities of Mitsuba 3's BSDF plugins, the reference of bsdf_reference.rs.

Run with `pip install mitsuba==3.9.1 numpy`; prints the file. Directions are local; `wo` is the known side (Mitsuba's `si.wi`).
"""

import json
import math

import mitsuba as mi

mi.set_variant("scalar_rgb")

RGB = [0.8, 0.4, 0.1]
AU = {"eta": [0.14, 0.37, 1.44], "k": [3.98, 2.38, 1.60]}


def rgb(v):
    return {"type": "rgb", "value": v}


def direction(theta_deg, phi_deg):
    t, p = math.radians(theta_deg), math.radians(phi_deg)
    return [math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)]


def facets(d, ax, ay):
    return {"distribution": d, "alpha_u": ax, "alpha_v": ay}


def cases():
    yield "diffuse", {"reflectance": RGB}
    yield "conductor", {**AU, "specular_reflectance": [0.9, 0.8, 0.7]}
    for d in ["ggx", "beckmann"]:
        for ax, ay in [(0.05, 0.05), (0.3, 0.3), (0.1, 0.4), (0.9, 0.9)]:
            yield "roughconductor", {**AU, **facets(d, ax, ay), "specular_reflectance": [1.0, 0.9, 0.8]}
        for eta in [1.5, 1.05, 0.75]:
            for ax, ay in [(0.1, 0.1), (0.3, 0.6)]:
                yield "roughdielectric", {**facets(d, ax, ay), "eta": eta}
        for alpha, eta, nonlinear in [(0.05, 1.5, False), (0.2, 1.49, True), (0.5, 1.9, False), (0.8, 1.3, True)]:
            yield "roughplastic", {"distribution": d, "alpha": alpha, "eta": eta, "nonlinear": nonlinear, "diffuse_reflectance": RGB}
    for eta in [1.5, 1.33, 0.6]:
        yield "dielectric", {"eta": eta}
    yield "thindielectric", {"eta": 1.5}
    for eta, nonlinear in [(1.5, False), (1.9, True), (1.3, False)]:
        yield "plastic", {"eta": eta, "nonlinear": nonlinear, "diffuse_reflectance": RGB, "specular_reflectance": [0.9, 0.9, 0.9]}


def load(model, params):
    d = {"type": model}
    for name, value in params.items():
        if name == "eta" and model not in ("conductor", "roughconductor"):
            d["int_ior"], d["ext_ior"] = value, 1.0
        elif isinstance(value, list):
            d[name] = rgb(value)
        else:
            d[name] = value
    return mi.load_dict(d)


def digits(x):
    return [float(f"{float(v):.7g}") for v in x] if hasattr(x, "__len__") else float(f"{float(x):.7g}")


def evaluations(bsdf, both_sides):
    rows = []
    thetas = [0, 35, 70, 88] + ([120, 160] if both_sides else [])
    for i, to in enumerate(thetas):
        wo = direction(to, 30)
        pairs = [(to + 2, 212), (to - 5, 190), (20, 140), (75, 260)]
        if both_sides:
            pairs += [(180 - 0.7 * to if to < 90 else 50, 212), (175 if to < 90 else 20, 250)]
        for ti, phi in pairs:
            wi = direction(ti, phi)
            si = mi.SurfaceInteraction3f()
            si.wi = wo
            radiance = mi.BSDFContext()
            importance = mi.BSDFContext(mi.TransportMode.Importance)
            row = {"wo": digits(wo), "wi": digits(wi), "value": digits(bsdf.eval(radiance, si, wi)), "pdf": digits(bsdf.pdf(radiance, si, wi))}
            if both_sides:
                row["value_importance"] = digits(bsdf.eval(importance, si, wi))
            rows.append(row)
    return rows


def deltas(bsdf, both_sides):
    rows = []
    for to in [0, 35, 70, 88] + ([120, 160] if both_sides else []):
        si = mi.SurfaceInteraction3f()
        si.wi = direction(to, 30)
        seen = set()
        for u in [1e-6, 1 - 1e-6]:
            s, weight = bsdf.sample(mi.BSDFContext(), si, u, [0.5, 0.5])
            delta = mi.has_flag(mi.BSDFFlags(s.sampled_type), mi.BSDFFlags.Delta) or mi.has_flag(mi.BSDFFlags(s.sampled_type), mi.BSDFFlags.Null)
            key = tuple(digits(s.wo))
            if delta and key not in seen and s.pdf > 0:
                seen.add(key)
                rows.append({"wo": digits(si.wi), "wi": digits(s.wo), "weight": digits(weight), "probability": digits(s.pdf), "eta": digits(s.eta)})
    return rows


out = []
for model, params in cases():
    bsdf = load(model, params)
    both = model in ("dielectric", "roughdielectric", "thindielectric")
    smooth = model in ("conductor", "dielectric", "thindielectric")
    case = {"model": model, "params": params, "evaluations": [] if smooth else evaluations(bsdf, both)}
    case["deltas"] = deltas(bsdf, both) if smooth or model == "plastic" else []
    out.append(case)
rows = ",\n".join(json.dumps(c, separators=(",", ":")) for c in out)
print('{"made_by":"bsdf_mitsuba.py, Mitsuba ' + mi.__version__ + '","cases":[\n' + rows + "\n]}")
