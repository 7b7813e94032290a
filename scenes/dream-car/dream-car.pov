#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 12 }
#include "materials.inc"
#include "body.inc"
#include "glass.inc"
#include "wheel.inc"
#include "lamps.inc"
#include "interior.inc"
#include "trim.inc"
#include "studio.inc"
#ifndef (View) #declare View = 0; #end
#switch (View)
  #case (0) camera { location <-5.6, 1.25, -4.7> right x*16/9 up y look_at <-0.12, 0.50, 0> angle 36 } #break
  #case (1) camera { location <0, 0.9, -8.5> right x*16/9 up y look_at <0, 0.6, 0> angle 34 } #break
  #case (2) camera { location <-8, 0.9, -0.01> right x*16/9 up y look_at <0, 0.6, 0> angle 26 } #break
  #case (3) camera { location <-0.01, 8, 0> right x*16/9 up y sky z look_at 0 angle 40 } #break
  #case (4) camera { location <5.6, 1.7, -4.4> right x*16/9 up y look_at <0.12, 0.5, 0> angle 36 } #break
  #case (5) camera { location <8, 1.0, -0.01> right x*16/9 up y look_at <0, 0.6, 0> angle 26 } #break
  #case (6) camera { location <-4, 1.0, -2.6> right x*16/9 up y look_at <-1.7, 0.45, -0.4> angle 36 } #break
  #case (7) camera { location <-3, 2.2, -2.6> right x*16/9 up y look_at <0, 0.9, 0> angle 36 } #break
#end
object { Both(Half_Body) }
object { Both(Half_House) }
object { Both(Half_Wheels) }
object { Both(Half_Headlamp) }
object { Both(Half_Tail_Lamp) }
object { Both(Half_Trim) }
object { Middle_Trim }
object { Interior }
