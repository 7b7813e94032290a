#!/usr/bin/env python3
"""Measures hits, normals and inside tests of POV-Ray's shapes: the tables under crates/render/src/solid/measured.

Runs the installed `povray` as a black box: `trace()` along random lines again and again behind each hit, and `inside()` at random points.
Each table holds lines `L ox oy oz dx dy dz (t nx ny nz)*` and `I x y z 0|1`.
"""

import pathlib
import random
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
TABLES = HERE.parent / "crates/render/src/solid/measured"

# name: (radius of the ball that holds the shape, center, SDL)
SHAPES = {
    "quartic_torus": (10, (0, 0, 0), "quartic{<1,0,0,0,2,0,0,2,0,-104,0,0,0,0,0,0,0,0,0,0,1,0,0,2,0,56,0,0,0,0,1,0,-104,0,784> sturm}"),
    "cubic": (2, (0, 0, 0), "cubic{<1,0.2,0,0.1,-0.3,0,0,1,0,-0.4,0,1,0.3,0.2,0,-1,0.5,0,0,0.1>}"),
    "poly6": (
        2,
        (0, 0, 0),
        "polynomial{6,xyz(6,0,0):1,xyz(0,6,0):2,xyz(0,0,6):1,xyz(2,2,2):-3,xyz(1,0,1):0.4,xyz(0,3,0):0.3,xyz(0,0,0):-0.5 sturm}",
    ),
    "blob": (
        2.2,
        (0, 0, 0),
        "blob{threshold 0.6 sphere{<.75,0,0>,1,1} sphere{<-.375,.65,0>,1,1 scale <1,1.5,0.7> rotate z*20} "
        "sphere{<-.375,-.65,0>,1,1} cylinder{<0,-1,-1>,<0.5,1,1>,0.7,1.2} sphere{<0.3,0.2,0.1>,0.8,-0.7} sturm}",
    ),
    "lathe_linear": (6, (0, 2.5, 0), "lathe{linear_spline 6,<2,0>,<3,0>,<3,5>,<2.2,4>,<2,5>,<2,0>}"),
    "lathe_open": (6, (0, 2.5, 0), "lathe{linear_spline 4,<1,0>,<3,1>,<2,3>,<2.5,5>}"),
    "lathe_quadratic": (6, (0, 2.5, 0), "lathe{quadratic_spline 6,<2.5,-0.5>,<2,0>,<3,0.2>,<3.4,4>,<2,5>,<2,0>}"),
    "lathe_cubic": (6, (0, 2.5, 0), "lathe{cubic_spline 7,<2,5>,<2,0>,<3,0.2>,<3.4,4>,<2,5>,<2,0>,<3,0.2> sturm}"),
    "lathe_bezier": (6, (0, 2.5, 0), "lathe{bezier_spline 8,<2,1>,<3,1.5>,<3.5,3.5>,<2,4>,<2,4>,<1,3>,<1.5,2>,<2,1> sturm}"),
    "sor": (
        1.3,
        (0, 0.5, 0),
        "sor{7,<0,0>,<0.118143,0>,<0.620253,0.540084>,<0.210970,0.827004>,<0.194093,0.962025>,<0.286920,1>,<0.468354,1.033755> sturm}",
    ),
    "sor_open": (
        1.3,
        (0, 0.5, 0),
        "sor{7,<0,0>,<0.118143,0>,<0.620253,0.540084>,<0.210970,0.827004>,<0.194093,0.962025>,<0.286920,1>,<0.468354,1.033755> open sturm}",
    ),
    "prism_linear": (7, (3, 0.5, 4), "prism{linear_spline 0,1,10,<0,0>,<6,0>,<6,8>,<0,8>,<0,0>,<1,1>,<5,1>,<5,7>,<1,7>,<1,1>}"),
    "prism_clockwise": (7, (3, 0.5, 4), "prism{linear_spline 1,0,5,<0,0>,<0,8>,<6,8>,<6,0>,<0,0>}"),
    "prism_quadratic": (
        7,
        (3, 1, 4),
        "prism{quadratic_spline -1,2,12,<1,-1>,<0,0>,<6,0>,<6,8>,<0,8>,<0,0>,<2,0>,<1,1>,<5,1>,<5,7>,<1,7>,<1,1>}",
    ),
    "prism_cubic": (
        7,
        (3, 1, 4),
        "prism{cubic_spline -1,2,14,<1,-1>,<0,0>,<6,0>,<6,8>,<0,8>,<0,0>,<-1,1>,<2,0>,<1,1>,<5,1>,<5,7>,<1,7>,<1,1>,<0,2> sturm}",
    ),
    "prism_bezier": (3, (0, 0.5, 0), "prism{bezier_spline 0,1,8,<-2,0>,<-2,2>,<1,2>,<2,0>,<2,0>,<2,-1>,<-1,-2>,<-2,0> sturm}"),
    "prism_conic": (4, (0, 0.6, 0), "prism{conic_sweep cubic_spline 0.2,1.3,6,<3,-5>,<3,5>,<-5,0>,<3,-5>,<3,5>,<-5,0> scale <0.5,1,0.5>}"),
    "prism_conic_linear": (4, (0, 0.5, 0), "prism{conic_sweep linear_spline -0.5,1,5,<4,4>,<-4,4>,<-4,-4>,<4,-4>,<4,4> scale <0.5,1,0.5>}"),
    "prism_open": (4, (0, 0.5, 0), "prism{linear_spline 0,1,4,<3,0>,<-2,2>,<-2,-2>,<3,0> open}"),
    "superellipsoid_box": (1.6, (0, 0, 0), "superellipsoid{<0.25,0.25>}"),
    "superellipsoid": (1.6, (0, 0, 0), "superellipsoid{<1.4,0.4>}"),
    "superellipsoid_star": (1.3, (0, 0, 0), "superellipsoid{<3,1.7>}"),
    "superellipsoid_cylinder": (1.6, (0, 0, 0), "superellipsoid{<1,0.1>}"),
    "height_field": (0.8, (0.5, 0.3, 0.5), "height_field{function 5,4 {0.1+0.8*abs(sin(7*x+5*y*y))}}"),
    "height_field_smooth": (0.8, (0.5, 0.3, 0.5), "height_field{function 9,7 {0.1+0.8*abs(sin(3*x+2*y*y))} smooth}"),
    "height_field_water": (0.8, (0.5, 0.5, 0.5), "height_field{function 9,7 {0.1+0.8*abs(sin(3*x+2*y*y))} smooth water_level 0.4}"),
    "bicubic_patch": (
        3,
        (1.5, 1.5, 0),
        "bicubic_patch{type 1 flatness 0 u_steps 2 v_steps 3 "
        "<0,0,2>,<1,0,0>,<2,0,0>,<3,0,-2>,<0,1,0>,<1,1,0>,<2,1,1>,<3,1,0>,<0,2,0>,<1,2,0>,<2,2,0>,<3,2,0>,<0,3,2>,<1,3,0>,<2,3,0>,<3,3,-2>}",
    ),
    "bicubic_flat": (
        3,
        (1.5, 1.5, 0),
        "bicubic_patch{type 0 flatness 0.1 u_steps 4 v_steps 4 "
        "<0,0,2>,<1,0,0>,<2,0,0>,<3,0,-2>,<0,1,0>,<1,1,0>,<2,1,1>,<3,1,0>,<0,2,0>,<1,2,0>,<2,2,0>,<3,2,0>,<0,3,2>,<1,3,0>,<2,3,0>,<3,3,-2>}",
    ),
    "julia": (1.6, (0, 0, 0), "julia_fractal{<-0.083,0.0,-0.83,-0.025> quaternion sqr max_iteration 5 precision 500}"),
    "julia_cube": (
        1.6,
        (0, 0, 0),
        "julia_fractal{<-0.2,0.3,0.4,0.1> quaternion cube max_iteration 4 precision 500 slice <0.1,0.2,0,1>,0.1}",
    ),
    "julia_hyper": (1.6, (0, 0, 0), "julia_fractal{<-0.5,0.3,0.2,0.1> hypercomplex sqr max_iteration 5 precision 500}"),
    "julia_sin": (3, (0, 0, 0), "julia_fractal{<0.3,0.2,0.1,0.1> hypercomplex sin max_iteration 4 precision 500}"),
    "julia_pwr": (2, (0, 0, 0), "julia_fractal{<-0.3,0.2,0.1,0.1> hypercomplex pwr(2.4,0.1) max_iteration 4 precision 500}"),
    "sphere_sweep_linear": (4, (1, 1, 0), "sphere_sweep{linear_spline 4,<-2,0,0>,0.5,<0,2,0>,1,<2,0,0>,0.3,<3,2,1>,0.7}"),
    "sphere_sweep_b": (4, (0, 1, 0), "sphere_sweep{b_spline 6,<-5,-1,0>,0.5,<-3,2,0>,1,<0,3,1>,0.6,<1,-2,0>,0.9,<3,2,1>,0.7,<5,0,0>,1}"),
    "sphere_sweep_cubic": (
        4,
        (0, 1, 0),
        "sphere_sweep{cubic_spline 6,<-5,-1,0>,0.5,<-3,2,0>,1,<0,3,1>,0.6,<1,-2,0>,0.9,<3,2,1>,0.7,<5,0,0>,1}",
    ),
    "ovus": (2.2, (0, 0.3, 0), "ovus{1,0.6}"),
    "ovus_big": (3, (0, 1, 0), "ovus{1,1.6}"),
    "torus": (1.5, (0, 0, 0), "torus{1,0.3 sturm}"),
    "torus_spindle": (1.8, (0, 0, 0), "torus{0.5,1 sturm}"),
}
LINES = 28
POINTS = 40
STEP = 2e-3


def measure(name, keep=None):
    """Measures one shape."""
    radius, center, sdl = SHAPES[name]
    rng = random.Random(name)

    def ball():
        while True:
            v = [rng.uniform(-1, 1) for _ in range(3)]
            if sum(x * x for x in v) <= 1:
                return [c + 0.9 * radius * x for c, x in zip(center, v)]

    text = [
        "#version 3.7;\nglobal_settings{assumed_gamma 1}\ncamera{location <0,0,-5> look_at 0}",
        f"#declare S={sdl}",
        '#fopen F "out.txt" write',
    ]
    for _ in range(LINES):
        a, b = ball(), ball()
        d = [y - x for x, y in zip(a, b)]
        n = sum(x * x for x in d) ** 0.5
        d = [round(x / n, 6) for x in d]
        o = [round(x - 2 * radius * y, 6) for x, y in zip(a, d)]
        v3 = lambda v: "<%.6f,%.6f,%.6f>" % tuple(v)
        text.append(
            f'#declare O={v3(o)};#declare D={v3(d)};#declare T=0;#declare K=0;#declare Go=1;\n#write(F,"L ",vstr(3,O," ",0,6)," ",vstr(3,D," ",0,6))\n'
            f"#while(Go & K<8)\n#declare N=<0,0,0>;#declare Q=O+D*(T+(K>0)*{STEP});#declare P=trace(S,Q,D,N);\n"
            '#if(vlength(N)>0)#declare T=vdot(P-O,D)/vdot(D,D);#write(F,"  ",str(T,0,9)," ",vstr(3,N," ",0,7))#declare K=K+1;#else #declare Go=0;#end\n#end\n#write(F,"\\n")'
        )
    for _ in range(POINTS if "patch" not in name and "flat" not in name else 0):
        p = "<%.6f,%.6f,%.6f>" % tuple(ball())
        text.append(f'#write(F,"I ",vstr(3,{p}," ",0,6)," ",inside(S,{p}),"\\n")')
    text.append("#fclose F\n")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "m.pov").write_text("\n".join(text))
        run = subprocess.run(["povray", "+Im.pov", "+Om.png", "+W4", "+H4", "-D", "-P", "+WT1"], cwd=folder, capture_output=True, text=True)
        if run.returncode:
            print(name, "failed\n", run.stderr[-800:])
            return
        table = (folder / "out.txt").read_text()
    (TABLES / f"{name}.txt").write_text(table)
    hits = sum(max(0, (len(l.split()) - 7) // 4) for l in table.splitlines() if l[0] == "L")
    print(name, "hits", hits, "inside", sum(l.startswith("I") and l.split()[-1] == "1" for l in table.splitlines()))


if __name__ == "__main__":
    for shape in sys.argv[1:] or SHAPES:
        measure(shape)
