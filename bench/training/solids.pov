// Every kind of solid and surface, alone and combined, on a checkered floor; mirrors and glass among them.
#version 3.7;
global_settings { assumed_gamma 1 max_trace_level 8 adc_bailout 0.004 }
camera { location <0, 8, -11> look_at <0, -0.6, -0.3> angle 50 right x*4/3 }
light_source { <-12, 20, -14> rgb 1 area_light 3*x, 3*z, 4, 4 adaptive 1 jitter circular orient }
light_source { <10, 12, -10> rgb 0.4 spotlight point_at 0 radius 25 falloff 40 tightness 2 }
sky_sphere { pigment { gradient y color_map { [0 rgb <0.7, 0.75, 0.85>] [1 rgb <0.2, 0.35, 0.7>] } } pigment { bozo turbulence 0.6 color_map { [0.5 rgbt 1] [1 rgbt <1, 1, 1, 0.2>] } scale 0.3 } }
plane { y, -1 pigment { checker rgb 0.85, rgb <0.35, 0.4, 0.45> } finish { reflection 0.08 } }

#declare Paint = texture { pigment { rgb <0.75, 0.2, 0.12> } finish { phong 0.7 phong_size 50 } }
#declare Metal = texture { pigment { rgb <0.85, 0.75, 0.45> } finish { ambient 0.05 diffuse 0.3 specular 0.8 roughness 0.01 metallic reflection { 0.5 metallic } } }
#declare Stone = texture { pigment { granite color_map { [0 rgb 0.8] [1 rgb <0.3, 0.3, 0.25>] } scale 0.7 } }
#declare Glass = material { texture { pigment { rgbf <0.95, 1, 0.97, 0.92> } finish { specular 0.9 roughness 0.001 reflection { 0, 1 fresnel } conserve_energy } } interior { ior 1.5 fade_power 1001 fade_distance 2 fade_color <0.4, 0.8, 0.5> } }
#declare Spot = 0;
#macro Place(O) object { O scale 0.7 translate <2.05 * (mod(Spot, 6) - 2.5), -0.3, 2.2 * (int(Spot / 6) - 1.5)> } #declare Spot = Spot + 1; #end

Place(torus { 0.7, 0.25 rotate 60*x texture { Metal } })
Place(blob { threshold 0.5 sphere { <-0.4, 0, 0>, 0.8, 1 } sphere { <0.4, 0.2, 0>, 0.8, 1 } cylinder { -0.6*y, 0.5*y, 0.4, 0.7 } texture { Paint } })
Place(isosurface { function { x*x + y*y + z*z - 0.8 + 0.15*sin(8*x)*sin(8*y)*sin(8*z) } contained_by { sphere { 0, 1.1 } } max_gradient 4 texture { Stone } })
Place(sor { 6, <0.1, -1.2>, <0.6, -1>, <0.7, -0.3>, <0.3, 0.3>, <0.5, 0.9>, <0.6, 1.2> open texture { Paint } })
Place(lathe { bezier_spline 4, <0.2, -0.9>, <0.9, -0.6>, <0.3, 0.2>, <0.7, 0.9> texture { Metal } })
Place(prism { cubic_spline -0.5, 0.5, 8, <-0.8, 0>, <0, 0.9>, <0.8, 0.2>, <0.5, -0.8>, <-0.6, -0.7>, <-0.8, 0>, <0, 0.9>, <0.8, 0.2> rotate -70*x texture { Stone } })
Place(julia_fractal { <-0.083, 0, -0.83, -0.025> quaternion sqr max_iteration 7 precision 15 scale 0.6 texture { Paint } })
Place(height_field { function 48, 48 { pattern { wrinkles scale 0.3 } } smooth translate <-0.5, -0.5, -0.5> scale 1.8 texture { Stone } })
Place(superellipsoid { <0.3, 0.6> rotate <20, 30, 0> scale 0.8 texture { Metal } })
Place(sphere_sweep { b_spline 6, <-1, -0.8, 0>, 0.2, <-0.6, 0.4, 0.3>, 0.25, <0, -0.4, -0.3>, 0.2, <0.5, 0.5, 0.2>, 0.3, <0.8, -0.2, 0>, 0.2, <1, 0.8, 0>, 0.2 tolerance 1e-4 texture { Paint } })
Place(ovus { 0.8, 0.4 translate -0.4*y texture { Stone } })
Place(quartic { <1, 0, 0, 0, 2, 0, 0, 2, 0, -1.3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0.7, 0, 0, 0, 0, 1, 0, -1.3, 0, 0.15> bounded_by { sphere { 0, 1.3 } } texture { Metal } })
Place(difference { box { -0.8, 0.8 } sphere { 0, 1.02 } cylinder { -2*z, 2*z, 0.4 } rotate <15, 25, 0> texture { Paint } })
Place(intersection { sphere { <-0.3, 0, 0>, 0.9 } sphere { <0.3, 0, 0>, 0.9 } plane { y, 0.5 } material { Glass } })
Place(merge { sphere { 0, 0.7 } cylinder { -x, x, 0.35 } cone { 0, 0.5, y, 0.1 } material { Glass } })
Place(union { cone { -0.9*y, 0.7, 0.3*y, 0.2 } disc { 0.4*y, y, 0.8, 0.3 } sphere { 0.7*y, 0.35 } texture { Metal } })
Place(quadric { <1, 0.4, 1>, 0, 0, -0.4 clipped_by { box { -1, 1 } } texture { Paint } interior_texture { Stone } })
Place(bicubic_patch { type 1 flatness 0.01 u_steps 3 v_steps 3
  #for (I, 0, 3) #for (J, 0, 3) <0.6*(J - 1.5), 0.6*sin(2*I + 1.7*J), 0.6*(I - 1.5)> #end #end texture { Paint } })
Place(parametric { function { cos(u) * (0.7 + 0.2*cos(v)) }, function { 0.25*sin(v) }, function { sin(u) * (0.7 + 0.2*cos(v)) } <0, 0>, <2*pi, 2*pi> contained_by { sphere { 0, 1.1 } } max_gradient 3 accuracy 0.002 texture { Stone } })
#declare Leaf = mesh {
  #for (I, 0, 15) #for (J, 0, 7)
    #macro At(A, B) <cos(A*pi/8) * sin(B*pi/8), 1.2*cos(B*pi/8), sin(A*pi/8) * sin(B*pi/8)> * (0.75 + 0.1*cos(3*A)) #end
    smooth_triangle { At(I, J), At(I, J), At(I + 1, J), At(I + 1, J), At(I, J + 1) + 1e-4*x, At(I, J + 1) }
    smooth_triangle { At(I + 1, J), At(I + 1, J), At(I + 1, J + 1), At(I + 1, J + 1), At(I, J + 1), At(I, J + 1) }
  #end #end
}
Place(object { Leaf texture { Metal } })
Place(poly { 4, <1, 0, 0, 0, 0, 0, 0, 0, 0, -0.8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, -0.8, 0, 0, 0, 0, 1, 0, -0.8, 0, 0.3> bounded_by { box { -1.2, 1.2 } } texture { Paint } })
Place(text { ttf "timrom.ttf", "Et", 0.4, 0 scale 1.2 translate <-0.6, -0.4, 0> texture { Metal } })
Place(polygon { 6, <-0.8, -0.8>, <0.8, -0.8>, <0.8, 0.8>, <0, 0.2>, <-0.8, 0.8>, <-0.8, -0.8> texture { Stone } })
Place(union { #for (I, 0, 40) sphere { vrotate(<0.8, 0, 0>, <0, 41*I, 11*I>), 0.09 } #end texture { Metal } })
