#!/usr/bin/env python3
"""Writes src/ior.rs and src/formats/mitsuba/cie.rs. Needs `pip install mitsuba numpy` (made with 3.9.1).

Refractive indices: the published measurements that Mitsuba 3 ships (Palik 1985, SOPRA, luxpop), taken to linear Rec. 709 as its RGB mode
does: integrated with the CIE 1931 observer under D65 and divided by the same integral of 1. CIE tables: the 1931 2-degree observer and D65,
CIE 015:2018, at 5 nm."""
import pathlib
import mitsuba as mi

here = pathlib.Path(__file__).resolve().parent.parent / 'src'
DIELECTRICS = ['vacuum', 'helium', 'hydrogen', 'air', 'carbon dioxide', 'water', 'acetone', 'ethanol', 'carbon tetrachloride', 'glycerol',
               'benzene', 'silicone oil', 'bromine', 'water ice', 'fused quartz', 'pyrex', 'acrylic glass', 'polypropylene', 'bk7',
               'sodium chloride', 'amber', 'pet', 'diamond']

def num(v):
    text = f'{v:.6g}'
    return text if '.' in text or 'e' in text else text + '.0'

mi.set_variant('scalar_rgb')
out = ['''//! Named refractive indices: dielectrics, and metals with their RGB complex index.
//!
//! Written by `scripts/tables.py`; sources and method are told there.

/// Refractive index of a named dielectric at visible wavelengths; `None` for an unknown name. Case does not matter.
pub fn dielectric(name: &str) -> Option<f32> {
    DIELECTRICS.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, v)| *v)
}

/// `(eta, k)` of a named metal in linear Rec. 709, without a perfect mirror `none`; `None` for an unknown name. Case matters (`Au`).
pub fn conductor(name: &str) -> Option<([f32; 3], [f32; 3])> {
    CONDUCTORS.iter().find(|(n, _, _)| *n == name).map(|(_, eta, k)| (*eta, *k))
}

/// Dielectrics.
pub const DIELECTRICS: &[(&str, f32)] = &[''']
for name in DIELECTRICS:
    eta = mi.traverse(mi.load_dict({'type': 'dielectric', 'int_ior': name, 'ext_ior': 1.0}))['eta']
    out.append(f'    ("{name}", {num(round(float(eta), 6))}),')
out.append('];\n\n/// Conductors: name, eta, k.\npub const CONDUCTORS: &[(&str, [f32; 3], [f32; 3])] = &[')
mi.set_log_level(mi.LogLevel.Error)
folder = pathlib.Path(mi.__file__).parent / 'data' / 'ior'
for file in sorted(folder.glob('*.eta.spd'), key=lambda f: f.name):
    name = file.name.removesuffix('.eta.spd')
    p = mi.traverse(mi.load_dict({'type': 'conductor', 'material': name}))
    rgb = lambda key: '[' + ', '.join(num(max(float(v), 0.0)) for v in p[key]) + ']'
    out.append(f'    ("{name}", {rgb("eta.value")}, {rgb("k.value")}),')
out.append('];\n\n#[cfg(test)]\nmod tests {\n    use super::*;\n\n    #[test]\n    fn names_are_found() {\n        assert_eq!(dielectric("BK7"), Some(1.5046));\n        assert!(conductor("Au").is_some_and(|(eta, k)| eta[0] < 0.2 && k[0] > 3.0));\n        assert!(conductor("Unobtainium").is_none());\n    }\n}')
(here / 'ior.rs').write_text('\n'.join(out) + '\n')

mi.set_variant('scalar_spectral')
d65 = mi.load_dict({'type': 'd65'})
rows = []
for l in range(360, 831, 5):
    si = mi.SurfaceInteraction3f()
    si.wavelengths = [float(l)] * 4
    rows.append((*[float(v) for v in mi.cie1931_xyz(float(l))], float(d65.eval(si)[0])))
y_d65 = rows[(560 - 360) // 5][3]
out = ['''//! CIE 1931 2-degree observer and the relative power of D65 (100 at 560 nm), CIE 015:2018, at 5 nm from 360 to 830 nm.
//!
//! Written by `scripts/tables.py`.

/// First wavelength in nanometres.
pub const FIRST_NM: f64 = 360.0;
/// Step in nanometres.
pub const STEP_NM: f64 = 5.0;

/// x, y, z and D65 for each wavelength.
pub const OBSERVER_D65: [[f64; 4]; %d] = [''' % len(rows)]
for x, y, z, d in rows:
    out.append('    [' + ', '.join(num(v) for v in (x, y, z, d / y_d65 * 100)) + '],')
out.append('];')
(here / 'formats/mitsuba/cie.rs').write_text('\n'.join(out) + '\n')
