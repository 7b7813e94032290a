// Every pattern, map, wave, warp and normal on a wall of tiles, without any file from elsewhere.
#version 3.7;
global_settings { assumed_gamma 1 max_trace_level 6 }
camera { orthographic location <6, 4, -20> look_at <6, 4, 0> right 14.4*x up 10.8*y }
light_source { <-20, 30, -40> rgb 1 }
light_source { <40, 10, -60> rgb 0.3 shadowless }
background { rgb <0.2, 0.25, 0.35> }

#declare Ramp = color_map { [0 rgb <0.1, 0.2, 0.5>] [0.4 rgb <0.8, 0.5, 0.2>] [0.7 rgb <0.9, 0.9, 0.7>] [1 rgb <0.3, 0.05, 0.05>] }
#declare Clear = color_map { [0 rgbt <0.1, 0.4, 0.2, 0.2>] [0.5 rgbt <1, 1, 1, 0.9>] [1 rgbf <0.6, 0.2, 0.1, 0.5>] }
#declare Plain = function { pattern { bozo scale 0.3 } }
#declare Tiles = array[48]
#declare Count = 0;
#macro Tile(P) #declare Tiles[Count] = P #declare Count = Count + 1; #end

Tile(texture { pigment { bozo color_map { Ramp } scale 0.2 turbulence 0.4 } })
Tile(texture { pigment { granite color_map { Ramp } scale 0.6 } })
Tile(texture { pigment { agate color_map { Ramp } scale 0.4 agate_turb 0.8 } })
Tile(texture { pigment { marble color_map { Ramp } turbulence 0.7 octaves 4 scale 0.4 rotate 30*z } finish { phong 0.6 phong_size 30 } })
Tile(texture { pigment { wood color_map { Ramp } turbulence <0.05, 0.08, 0.5> scale 0.15 rotate <4, 82, 0> } })
Tile(texture { pigment { crackle color_map { Ramp } scale 0.25 } })
Tile(texture { pigment { crackle form <-1, 1, 0> metric 1 offset 0.1 color_map { Ramp } scale 0.25 } })
Tile(texture { pigment { leopard color_map { Ramp } scale 0.07 } finish { specular 0.5 roughness 0.02 } })
Tile(texture { pigment { wrinkles color_map { Ramp } scale 0.5 } })
Tile(texture { pigment { dents color_map { Ramp } scale 0.2 } })
Tile(texture { pigment { spotted color_map { Ramp } scale 0.2 sine_wave frequency 2 } })
Tile(texture { pigment { onion color_map { Ramp } scale 0.2 triangle_wave } })
Tile(texture { pigment { radial color_map { Ramp } frequency 6 rotate 90*x } })
Tile(texture { pigment { spiral1 5 color_map { Ramp } scale 0.5 turbulence 0.1 } })
Tile(texture { pigment { spiral2 3 color_map { Ramp } scale 0.5 cubic_wave } })
Tile(texture { pigment { mandel 40 color_map { Ramp } scale 0.4 exterior 1, 2 } })
Tile(texture { pigment { julia <0.353, 0.288>, 30 color_map { Ramp } scale 0.5 interior 1, 1 } })
Tile(texture { pigment { cells color_map { Ramp } scale 0.2 } })
Tile(texture { pigment { gradient x + y color_map { Ramp } scale 0.3 scallop_wave phase 0.2 } })
Tile(texture { pigment { planar color_map { Ramp } poly_wave 2 } })
Tile(texture { pigment { boxed color_map { Ramp } } })
Tile(texture { pigment { cylindrical color_map { Ramp } rotate 90*x ramp_wave } })
Tile(texture { pigment { spherical color_map { Ramp } warp { turbulence 0.5 octaves 3 lambda 2.5 omega 0.4 } } })
Tile(texture { pigment { checker rgb 0.9, rgb <0.7, 0.1, 0.1> scale 0.2 } })
Tile(texture { pigment { hexagon rgb <0.8, 0.7, 0.3>, rgb <0.2, 0.5, 0.3>, rgb <0.2, 0.2, 0.5> rotate 90*x scale 0.15 } })
Tile(texture { pigment { brick rgb 0.8, rgb <0.6, 0.25, 0.2> scale 0.06 } normal { brick 0.4 scale 0.06 } })
Tile(texture { pigment { square rgb 0.9, rgb 0.2, rgb <0.7, 0.2, 0.1>, rgb <0.2, 0.4, 0.6> rotate 90*x scale 0.2 } })
Tile(texture { pigment { triangular rgb 0.9, rgb 0.2, rgb <0.7, 0.2, 0.1>, rgb <0.2, 0.4, 0.6>, rgb <0.6, 0.6, 0.1>, rgb <0.1, 0.6, 0.4> rotate 90*x scale 0.25 } })
Tile(texture { pigment { function { Plain(x, y, z) * abs(sin(5*x + 3*y)) } color_map { Ramp } } })
Tile(texture { pigment { wood pigment_map { [0 bozo color_map { Ramp } scale 0.1] [0.6 granite color_map { Ramp }] [1 rgb <0.2, 0.1, 0.05>] } scale 0.3 } })
Tile(texture { gradient y texture_map { [0.3 pigment { rgb 0.8 } finish { metallic specular 0.8 }] [0.7 pigment { agate color_map { Ramp } }] } scale 0.5 })
Tile(texture { pigment { average pigment_map { [1 checker rgb 1, rgb 0 scale 0.3] [2 bozo color_map { Ramp } scale 0.2] } } })
Tile(texture { pigment { rgb <0.7, 0.6, 0.3> } normal { bumps 0.6 scale 0.08 } finish { phong 0.8 } })
Tile(texture { pigment { rgb <0.3, 0.5, 0.7> } normal { ripples 0.7 frequency 8 scale 0.4 } finish { specular 0.8 roughness 0.01 } })
Tile(texture { pigment { rgb <0.3, 0.7, 0.5> } normal { waves 0.5 frequency 6 scale 0.5 turbulence 0.2 } finish { phong 1 phong_size 60 metallic } })
Tile(texture { pigment { rgb 0.7 } normal { quilted 0.8 control0 0.7 control1 0.3 scale 0.2 } finish { brilliance 2 specular 0.4 } })
Tile(texture { pigment { rgb 0.6 } normal { wrinkles 1.2 scale 0.2 } finish { reflection { 0.1, 0.5 fresnel } conserve_energy } })
Tile(texture { pigment { rgb <0.5, 0.3, 0.2> } normal { dents 0.8 scale 0.1 } finish { diffuse 0.7 crand 0.05 } })
Tile(texture { pigment { rgb 0.8 } normal { gradient x normal_map { [0.3 bumps 0.8 scale 0.1] [0.8 granite 0.3 scale 0.5] } } })
Tile(texture { pigment { rgb <0.8, 0.8, 0.4> } normal { function { 0.1 * sin(20*x) * sin(20*y) } 1 } finish { irid { 0.3 thickness 0.3 turbulence 0.4 } } })
Tile(texture { pigment { rgb <0.4, 0.25, 0.1> } } texture { pigment { wood color_map { Clear } turbulence 0.1 scale 0.2 rotate 85*y } } texture { pigment { bozo color_map { Clear } scale 0.3 } finish { specular 0.6 } })
Tile(texture { pigment { image_map { function 64, 64 { pattern { granite scale 0.5 } } interpolate 2 } translate -0.5 } })
Tile(texture { pigment { image_pattern { function 64, 64 { pattern { bozo scale 0.1 } } interpolate 4 } color_map { Ramp } translate -0.5 } })
Tile(texture { pigment { bozo color_map { Ramp } scale 0.2 warp { repeat 0.5*x flip x } warp { black_hole <0.2, 0.2, 0>, 0.4 strength 0.8 } } })
Tile(texture { pigment { gradient x color_map { Ramp } scale 0.2 warp { spherical orientation z } warp { planar } } })
Tile(texture { material_map { function 32, 32 { pattern { checker scale 0.25 } } texture { pigment { rgb 0.8 } } texture { pigment { granite } } } translate -0.5 })
Tile(texture { pigment { slope y color_map { Ramp } } normal { bumps 0.9 scale 0.3 } })

#for (I, 0, Count - 1)
  object {
    #switch (mod(I, 3))
      #case (0) box { <-0.7, -0.62, -0.1>, <0.7, 0.62, 0.1> #break
      #case (1) sphere { 0, 0.66 #break
      #else cylinder { -0.6*y, 0.6*y, 0.55
    #end
    texture { Tiles[I] }
    translate <1.6 * mod(I, 8) + 0.4, 1.62 * int(I / 8), 0>
  } }
#end
plane { z, 3 pigment { gradient y color_map { [0 rgb 0.2] [1 rgb 0.5] } scale 12 } }
