// What light does in the classic model: media, fog, photons, radiosity, glass, focal blur, all kinds of lamps.
#version 3.7;
global_settings {
  assumed_gamma 1
  max_trace_level 6
  radiosity { count 60 nearest_count 6 error_bound 0.8 recursion_limit 1 pretrace_start 0.08 pretrace_end 0.02 }
  photons { count 15000 }
}
camera { location <0, 2.2, -7> look_at <0, 0.9, 0> angle 50 right x*4/3 aperture 0.1 blur_samples 9 focal_point <0, 0.8, 0> variance 0 }
light_source { <2, 3.6, -1> rgb <1, 0.9, 0.75> * 0.7 area_light 0.6*x, 0.6*z, 3, 3 jitter fade_distance 3 fade_power 2 }
light_source { <-2.4, 3, -2> rgb <0.5, 0.7, 1> spotlight point_at <-0.8, 0, 0.4> radius 12 falloff 18 photons { refraction on reflection on } }
light_source { <0, 3.5, 2> rgb 0.2 cylinder point_at <0.5, 0, 1> radius 0.6 falloff 1 media_attenuation on }
light_source { <-9, 9, -9> rgb 0.15 parallel point_at 0 }
fog { fog_type 2 distance 30 rgb <0.6, 0.65, 0.7> fog_alt 0.6 fog_offset 0.1 turbulence 0.3 }
box { <-3, 0, -8>, <3, 4, 3> inverse hollow
  texture { pigment { checker rgb <0.8, 0.78, 0.7>, rgb <0.75, 0.55, 0.45> scale 0.7 } normal { bumps 0.1 scale 0.1 } finish { diffuse 0.8 ambient 0 } } }
sphere { <-0.8, 0.7, 0.4>, 0.7 pigment { rgbf 0.96 } finish { reflection { 0.02, 1 fresnel } conserve_energy specular 0.7 roughness 0.002 } interior { ior 1.5 dispersion 1.02 } photons { target refraction on reflection on } }
sphere { <0.9, 0.6, 0.8>, 0.6 pigment { rgb 0.05 } finish { reflection 0.85 ambient 0 diffuse 0.1 } }
cylinder { <0.3, 0, -0.8>, <0.3, 0.9, -0.8>, 0.25 pigment { rgbt <0.7, 0.9, 0.8, 0.6> } finish { phong 0.8 } }
box { -0.5, 0.5 pigment { rgbt 1 } hollow
  interior { media { scattering { 2, rgb 0.9 extinction 0.6 } absorption rgb <0.1, 0.3, 0.5> samples 12 method 3 density { bozo turbulence 0.5 color_map { [0.3 rgb 0] [1 rgb 3] } scale 0.3 } } }
  translate <1.9, 0.6, 0.9> }
sphere { 0, 0.45 pigment { rgbt 1 } hollow
  interior { media { emission <2.4, 1, 0.3> method 1 intervals 4 samples 3, 4 density { spherical turbulence 0.4 density_map { [0 rgb 0] [0.5 rgb 1] [1 rgb 3] } scale 0.45 } } }
  translate <-2, 0.6, 1.6> }
union { #for (I, 0, 11) box { <-0.1, 0, -0.1>, <0.1, 0.2 + 0.1*mod(I, 4), 0.1> rotate 20*I*y translate <-2.4 + 0.4*I, 0, 2.2> } #end
  pigment { marble turbulence 0.5 color_map { [0 rgb 0.9] [1 rgb <0.4, 0.3, 0.3>] } scale 0.4 } finish { specular 0.3 } }
