"""Makes ior_data.rs: refractive indices by name. Run with `pip install mitsuba==3.9.1`; prints the file.

Sources of the spectra:
- the data set of Mitsuba 3 (from luxpop.com, and from Palik 1998, "Handbook of Optical Constants of Solids", by way of SOPRA);
- Fe, Ti, Co, Pd: Johnson and Christy 1974, "Optical constants of transition metals", doi:10.1103/PhysRevB.9.5056;
- Pt: Rakić et al. 1998, "Optical properties of metallic films", doi:10.1364/AO.37.005271, Brendel-Bormann fit.
The last two are rows of the refractiveindex.info database (public domain, CC0 1.0).

All go through Mitsuba's RGB mode (CIE 1931 observer, linear Rec. 709, lanes below zero set to zero), so that named metals look
alike in both programs. It converts the spectra of its own data set without adaptation of white: an index of 1 at all wavelengths
would become (1.2, 0.95, 0.91). The five metals below are adapted to equal-energy white, as spectra in its scene files are.
"""

import re

import mitsuba as mi

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)

DIELECTRICS = """vacuum, helium, hydrogen, air, carbon dioxide, water, acetone, ethanol, carbon tetrachloride, glycerol, benzene,
silicone oil, bromine, water ice, fused quartz, pyrex, acrylic glass, polypropylene, bk7, sodium chloride, amber, pet, diamond"""

MITSUBA = """a-C Ag Al AlAs AlSb Au Be Cr CsI Cu Cu2O CuO Cu_palik d-C Hg HgTe Ir K Li MgO Mo Na_palik Nb Ni_palik Rh Se Se-e SiC
SnTe Ta Te Te-e ThF4 TiC TiN TiO2 TiO2-e V_palik VC VN W"""

# Wavelength in micrometers, n, k.
MEASURED = {
    "Co": """0.342 1.48 2.52 0.354 1.49 2.61 0.368 1.50 2.71 0.381 1.53 2.82 0.397 1.57 2.93 0.413 1.61 3.05 0.431 1.67 3.17 0.451 1.74 3.28
        0.471 1.81 3.41 0.496 1.88 3.55 0.521 1.97 3.68 0.549 2.05 3.82 0.582 2.13 3.96 0.617 2.19 4.11 0.659 2.25 4.27 0.704 2.31 4.45
        0.756 2.40 4.64 0.821 2.53 4.88 0.892 2.65 5.16""",
    "Fe": """0.342 1.85 2.27 0.354 1.93 2.35 0.368 2.02 2.43 0.381 2.12 2.50 0.397 2.24 2.58 0.413 2.35 2.65 0.431 2.48 2.71 0.451 2.59 2.77
        0.471 2.67 2.82 0.496 2.74 2.88 0.521 2.86 2.91 0.549 2.95 2.93 0.582 2.94 2.99 0.617 2.88 3.05 0.659 2.92 3.10 0.704 2.86 3.19
        0.756 2.87 3.28 0.821 2.94 3.39 0.892 2.96 3.56""",
    "Pd": """0.342 1.22 2.57 0.354 1.23 2.65 0.368 1.24 2.74 0.381 1.26 2.83 0.397 1.30 2.93 0.413 1.33 3.03 0.431 1.37 3.14 0.451 1.41 3.26
        0.471 1.46 3.39 0.496 1.52 3.54 0.521 1.57 3.68 0.549 1.64 3.84 0.582 1.68 4.02 0.617 1.75 4.21 0.659 1.80 4.42 0.704 1.86 4.65
        0.756 1.95 4.89 0.821 2.06 5.19 0.892 2.23 5.50""",
    "Pt": """0.34637 1.5870 2.5154 0.36025 1.6254 2.6062 0.37470 1.6643 2.6963 0.38973 1.7032 2.7867 0.40535 1.7418 2.8785 0.42161 1.7804 2.9727
        0.43852 1.8193 3.0702 0.45610 1.8591 3.1717 0.47439 1.9006 3.2774 0.49341 1.9445 3.3878 0.51320 1.9916 3.5027 0.53378 2.0427 3.6219
        0.55518 2.0984 3.7451 0.57744 2.1592 3.8715 0.60060 2.2255 4.0007 0.62468 2.2974 4.1318 0.64973 2.3748 4.2641 0.67579 2.4574 4.3969
        0.70289 2.5449 4.5297 0.73107 2.6366 4.6618 0.76039 2.7317 4.7932 0.79088 2.8294 4.9238 0.83893 2.9790 5.1191""",
    "Ti": """0.342 1.72 2.82 0.354 1.82 2.87 0.368 1.90 2.90 0.381 1.99 2.93 0.397 2.08 2.95 0.413 2.14 2.98 0.431 2.21 3.01 0.451 2.27 3.04
        0.471 2.32 3.10 0.496 2.36 3.19 0.521 2.44 3.30 0.549 2.54 3.43 0.582 2.60 3.58 0.617 2.67 3.72 0.659 2.76 3.84 0.704 2.86 3.96
        0.756 3.00 4.01 0.821 3.21 4.01 0.892 3.29 3.96""",
}


def triple(v):
    return "[" + ", ".join(f"{float(x):.6g}" if float(x) % 1 else f"{float(x):.1f}" for x in v) + "]"


def metal(**params):
    p = mi.traverse(mi.load_dict({"type": "conductor", **params}))
    return p["eta.value"], p["k.value"]


def spectrum(values):
    return {"type": "spectrum", "value": values}


rows = {}
for name in MITSUBA.split():
    rows[name.removesuffix("_palik") if name != "Cu_palik" else name] = metal(material=name)
for name, text in MEASURED.items():
    v = [float(x) for x in text.split()]
    nm = [1000 * x for x in v[0::3]]
    rows[name] = metal(eta=spectrum(list(zip(nm, v[1::3]))), k=spectrum(list(zip(nm, v[2::3]))))

print("//! Refractive indices by name. Made by ior_data.py, which names the sources: do not edit.\n")
print("/// Dielectrics: name, index against vacuum.")
print("pub const DIELECTRICS: &[(&str, f32)] = &[")
for name in re.split(r",\s*", DIELECTRICS):
    eta = mi.traverse(mi.load_dict({"type": "dielectric", "int_ior": name, "ext_ior": "vacuum"}))["eta"]
    print(f'    ("{name}", {eta:.6g}),' if eta % 1 else f'    ("{name}", {eta:.1f}),')
print("];\n")
print("/// Metals and other conductors: name, real and imaginary part of the index against vacuum in linear Rec. 709 RGB.")
print("pub const CONDUCTORS: &[(&str, [f32; 3], [f32; 3])] = &[")
print('    ("none", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),')
for name, (eta, k) in sorted(rows.items(), key=lambda r: r[0].lower()):
    print(f'    ("{name}", {triple(eta)}, {triple(k)}),')
print("];")
