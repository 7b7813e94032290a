#version 3.7;
global_settings { assumed_gamma 1 ambient_light rgb 1 radiosity { count 10 } photons { count 10 } }
camera { orthographic location -5*z look_at 0 right 4*x up 3*y aperture 0.1 focal_point 0 }
background { rgb 0.1 } fog { fog_type 2 distance 10 color rgb 1 fog_alt 1 }
sky_sphere { pigment { gradient y color_map { [0 rgb 1] [1 rgb <0,0,1>] } } }
rainbow { angle 40 width 5 distance 100 color_map { [0 rgb 1] [1 rgbt 1] } direction -z }
light_source { <1,2,-3> rgb 1 spotlight radius 10 falloff 20 point_at 0 area_light x, y, 3, 3 adaptive 1 jitter }
#declare T = texture { pigment { bozo turbulence 0.5 color_map { [0 rgb 0] [1 rgb 1] } warp { repeat x } scale 2 } normal { bumps 0.3 } finish { phong 1 reflection { 0.1, 0.5 fresnel } } }
difference { box { -1, 1 } cylinder { -2*y, 2*y, 0.5 } texture { T } interior { ior 1.5 media { emission 1 density { spherical } } } bounded_by { sphere { 0, 3 } } }
merge { cone { 0, 1, y, 0 } torus { 1, 0.2 sturm } plane { y, -1 clipped_by { box { -2, 2 } } } }
blob { threshold 0.5 sphere { 0, 1, 1 } cylinder { 0, y, 1, 1 } }
lathe { cubic_spline 4, <0,0>, <1,0>, <1,1>, <0,1> }
prism { linear_sweep linear_spline 0, 1, 4, <0,0>, <1,0>, <1,1>, <0,0> }
sor { 4, <0.1,-1>, <0.5,0>, <0.3,1>, <0.1,2> } superellipsoid { <0.5, 0.5> } quadric { <1,1,1>, 0, 0, -1 }
mesh { triangle { 0, x, y } smooth_triangle { 0, z, x, z, y, z } inside_vector y }
mesh2 { vertex_vectors { 3, 0, x, y } face_indices { 1, <0,1,2> } }
bicubic_patch { type 1 u_steps 2 v_steps 2 <0,0,0> <1,0,0> <2,0,0> <3,0,0> <0,1,0> <1,1,1> <2,1,1> <3,1,0> <0,2,0> <1,2,1> <2,2,1> <3,2,0> <0,3,0> <1,3,0> <2,3,0> <3,3,0> }
isosurface { function { x*x + y*y + z*z - 1 } contained_by { sphere { 0, 2 } } max_gradient 4 }
parametric { function { u }, function { v }, function { u*v } <0,0>, <1,1> contained_by { box { -2, 2 } } }
sphere_sweep { linear_spline 2, 0, 1, x, 0.5 } julia_fractal { <0,1,0,0> quaternion sqr } ovus { 1, 0.5 } poly { 2, <1,0,0,0,1,0,0,1,0,-1> }
polygon { 4, 0, x, y, 0 } disc { 0, y, 1, 0.5 } height_field { function 4, 4 { x*y } smooth }
object { sphere { 0, 1 } material { texture { pigment { checker rgb 0, rgb 1 } } } matrix <1,0,0,0,1,0,0,0,1,0,0,0> no_shadow hollow }
