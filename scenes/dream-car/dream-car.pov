#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 12 }
#include "materials.inc"
#include "body.inc"
#include "studio.inc"
#ifndef (View) #declare View = 0; #end
#switch (View)
  #case (0) camera { location <-5.6, 1.25, -4.7> right x*16/9 up y look_at <-0.12, 0.50, 0> angle 36 } #break
  #case (1) camera { location <0, 0.9, -8.5> right x*16/9 up y look_at <0, 0.6, 0> angle 34 } #break
  #case (2) camera { location <-8, 0.9, -0.01> right x*16/9 up y look_at <0, 0.6, 0> angle 26 } #break
  #case (3) camera { location <-0.01, 8, 0> right x*16/9 up y sky z look_at 0 angle 40 } #break
  #case (4) camera { location <5.6, 1.7, -4.4> right x*16/9 up y look_at <0.12, 0.5, 0> angle 36 } #break
  #case (5) camera { location <8, 1.0, -0.01> right x*16/9 up y look_at <0, 0.6, 0> angle 26 } #break
#end
#declare Arch = union{cylinder{<Axle_Front,Wheel_Radius,.5>,<Axle_Front,Wheel_Radius,1.5>,Arch_Radius} cylinder{<Axle_Rear,Wheel_Radius,.5>,<Axle_Rear,Wheel_Radius,1.5>,Arch_Radius}}
object{Both(object{Body_Half clipped_by{object{Arch inverse}}}) texture{Coat_Paint} interior_texture{Black_Void} interior{Coat_Interior}}
object{Both(House_Half) texture{Black_Gloss} interior_texture{Black_Void}}
union{
#for(S,-1,1,2) #for(A,0,1)
 cylinder{<(A?Axle_Rear:Axle_Front),Wheel_Radius,S*.66>,<(A?Axle_Rear:Axle_Front),Wheel_Radius,S*.92>,Wheel_Radius texture{Rubber}}
 cylinder{<(A?Axle_Rear:Axle_Front),Wheel_Radius,S*.66>,<(A?Axle_Rear:Axle_Front),Wheel_Radius,S*.925>,.25 texture{Alloy}}
#end #end
}
