// dream-car.pov - a gran turismo of our own, modelled in POV-Ray's scene description language.
// SPDX-License-Identifier: MIT OR Apache-2.0
//
//   etendue render scenes/dream-car/dream-car.pov -o dream-car.png --width 1920 --height 1080
//   povray +Idream-car.pov +W1920 +H1080 +A0.3
//
// Two switches, both numbers, may be declared from outside (POV-Ray: Declare=View=4):
//   Quality   0 draft, 1 normal, 2 finer soft shadows and radiosity
//   View      0 the picture, 1 side, 2 front, 3 above, 4 rear, 5 tail, 6 nose, 7 cabin: to look at the model while working on it
#version 3.7;

#ifndef (Quality) #declare Quality = 1; #end
#ifndef (View) #declare View = 0; #end

global_settings {
  assumed_gamma 1.0
  max_trace_level 8
  #if (Quality >= 2)
    radiosity { pretrace_end 0.01 count 100 error_bound 0.6 recursion_limit 2 }
  #end
}

#include "materials.inc"   // paint, chrome, glass, leather
#include "loft.inc"        // tools: lofted surfaces, outlines, cutters, wires, bars
#include "body.inc"        // the lines plan, the two large surfaces, doors and hood
#include "glass.inc"       // roof and windows
#include "wheel.inc"       // tires, rims, brakes
#include "lamps.inc"       // headlamps and tail lamps
#include "interior.inc"    // seats, dashboard, steering wheel
#include "trim.inc"        // grille, badge, plate, mirrors, wipers
#include "studio.inc"      // floor, wall, softboxes, lights

// --- cameras ------------------------------------------------------------------------------------------------------------------
#macro Camera(From, To, Angle)
  camera {
    location From
    right x*16/9
    up y
    sky (abs(From.x) + abs(From.z) < 0.1 ? 1 : 0)*z + y
    angle Angle
    look_at To
  }
#end
#switch (View)
  #case (1) Camera(< 0.0, 0.90, -8.5>,  < 0.0, 0.60, 0>, 34) #break
  #case (2) Camera(<-8.0, 0.90,  0.0>,  < 0.0, 0.60, 0>, 26) #break
  #case (3) Camera(< 0.0, 4.20,  0.01>, < 0.0, 0.00, 0>, 72) #break
  #case (4) Camera(< 5.6, 1.70, -4.4>,  < 0.1, 0.50, 0>, 36) #break
  #case (5) Camera(< 8.0, 1.00,  0.0>,  < 0.0, 0.60, 0>, 26) #break
  #case (6) Camera(<-4.0, 1.00, -2.6>,  <-1.7, 0.45, -0.4>, 36) #break
  #case (7) Camera(<-3.0, 1.90, -3.2>,  < 0.1, 0.90, 0>, 28) #break
  #else     Camera(<-5.6, 1.15, -4.7>,  <-0.1, 0.52, 0>, 34.5)
#end

// --- the car ------------------------------------------------------------------------------------------------------------------
#declare Car = union {
  object { Both(Half_Body) }
  object { Both(Half_House) }
  object { Both(Half_Wheels) }
  object { Both(Half_Headlamp) }
  object { Both(Half_Tail_Lamp) }
  object { Both(Half_Trim) }
  object { Middle_Trim }
  object { Interior }
}
object { Car }
