// Rays cast through combinations and basic shapes with `trace`: distances and the cosine between normal and ray; whether two points are
// inside; boxes. Run with POV-Ray 3.7.0.10 (`povray +Icombinations.pov +W8 +H8 -D`) it gave combinations.txt, wrapped lines joined.
#version 3.7; global_settings { assumed_gamma 1 }
#declare Sol=1;
#macro Cast(L,O,A,B)
  #local D = vnormalize(B-A); #local P=A; #local K=0; #local S="";
  #while (K<12)
    #local N=<0,0,0>; #local H=trace(O,P,D,N);
    #if (vlength(N)=0) #local K=99; #else
      #local S=concat(S," ",str(vlength(H-A),0,2),"(",str(vdot(N,D),0,1),")"); #local P=H+D*1e-3; #local K=K+1;
    #end
  #end
  #debug concat("R ",L," ",S," in ",#if(Sol) str(inside(O,A+D*2.0),0,0),str(inside(O,A+D*2.9),0,0), #end "\n")
#end
#declare A = box { -1,1 }
#declare B = sphere { 0.3*x, 0.8 }
#declare C = sphere { -0.3*x, 0.8 }
#macro All(O,L)
  Cast(concat(L,"x"),O,<-3,0.1,0.2>,<3,0.1,0.2>) Cast(concat(L,"y"),O,<0.1,-3,0.2>,<0.1,3,0.2>) Cast(concat(L,"d"),O,<-3,-3,-3>,<1.1,1,1>)
#end
All(union{object{A}object{B}object{C}},"union")
All(merge{object{A}object{B}object{C}},"merge")
All(merge{object{B}object{C}},"merge2")
All(difference{object{A}intersection{object{B}object{C}}},"A-BnC")
All(difference{object{A}union{object{B}object{C}}},"A-BuC")
All(difference{object{A}merge{object{B}object{C}}},"A-BmC")
All(difference{object{A}difference{object{B}object{C}}},"A-(B-C)")
All(intersection{union{object{B}object{C}}object{A}},"BuCnA")
All(union{object{B}object{C} inverse},"~(BuC)")
All(intersection{object{B}object{C} inverse},"~(BnC)")
All(difference{object{B}object{C} inverse},"~(B-C)")
All(intersection{object{A inverse} sphere {0,1.6}},"~A")
All(merge{union{object{B}object{C}}box{-0.5,0.5}},"mU")
All(object{A clipped_by{B}},"clip")
All(object{A clipped_by{sphere{0.3*x,0.8 inverse}}},"clipi")
All(object{A clipped_by{B} inverse},"clip~")
All(object{A inverse clipped_by{B}},"~clip")
All(intersection{object{A clipped_by{B}} sphere{0,0.9}},"clipn")
All(disc{0,y,1},"disc")
// Beside the disc's own height POV-Ray's box of the intersection hides it.
#declare O=intersection{disc{0.12*y,y,1} object{B}}
Cast("discny",O,<0.1,-3,0.2>,<0.1,3,0.2>) Cast("discnd",O,<-3,-3,-3>,<1.1,1,1>)
All(difference{object{A} disc{0.12*y,y,0.5}},"A-disc")
All(cylinder{-1.01*y,y,0.5 open},"opencyl")
All(difference{object{A}cylinder{-2*y,2*y,0.5 open}},"A-opencyl")
#declare Sol=0; All(triangle{<-2,0,-2>,<2,0,-2>,<0,0,3>},"tri") #declare Sol=1;
#declare Sol=0; All(triangle{<-2,0,-2>,<0,0,3>,<2,0,-2>},"tri2") #declare Sol=1;
#declare Sol=0; All(triangle{<-2,0,-2>,<0,0,3>,<2,0,-2> scale <-1,1,1>},"tri3") #declare Sol=1;
#declare Sol=0; All(polygon{4,<-1,-1,0>,<1,-1,0>,<1,1,0>,<-1,1,0> rotate 80*y},"poly") #declare Sol=1;
#declare Sol=0; All(polygon{4,<-1,-1,0>,<-1,1,0>,<1,1,0>,<1,-1,0> rotate 80*y},"poly2") #declare Sol=1;
#declare Sol=0; All(polygon{4,<-1,-1>,<-1,1>,<1,1>,<1,-1> rotate 80*x},"poly3") #declare Sol=1;
#declare Sol=0; All(mesh{triangle{<-2,0,-2>,<2,0,-2>,<0,0,3>}},"mesh") #declare Sol=1;
All(cone{-y,0.2,y,0.9},"cone")
All(cone{-y,-0.2,y,0.9},"coneneg")
All(torus{0.7,0.3},"torneg")
All(torus{0.3,0.6 rotate 90*x},"spindle")
All(sphere{0,-1},"sneg")
All(plane{<1,2,0.5>,0.3},"plane")
All(quadric{<1,1,1>,0,0,-1},"quad")
All(quadric{<-1,-1,-1>,0,0,1},"quadn")
#declare Sol=0; All(smooth_triangle{<-2,0,-2>,<0,1,0.5>,<2,0,-2>,<0.5,1,0>,<0,0,3>,<0,1,0>},"smooth") #declare Sol=1;
#macro Ext(L,O) #debug concat("R ext ",L," ",vstr(3,min_extent(O)," ",0,3)," ",vstr(3,max_extent(O)," ",0,3),"\n") #end
Ext("A",A) Ext("U",union{object{A}object{B} rotate 30*z}) Ext("D",difference{object{B}object{A}}) Ext("I",intersection{object{B}object{A}}) Ext("p",plane{y,1}) Ext("t",torus{1,0.3 rotate 30*x}) Ext("q",quadric{<1,1,1>,0,0,-1}) Ext("In",intersection{quadric{<1,0,1>,0,0,-1} plane{y,1} plane{-y,1}}) Ext("cl",sphere{0,1 clipped_by{box{0,2}}}) Ext("S",sphere{0,1 rotate 45*z scale <1,2,3>})
All(plane{y,0.12},"pl")
All(plane{-y,-0.12},"plm")
All(box{<-1,0.12,-1>,1},"bx")
All(box{<-1,-1,-1>,<1,0.12,1>},"bxt")
#macro In(L,O) #debug concat("R in ",L,str(inside(O,<0.1,0.1,0.2>),0,0),str(inside(O,<0,1,0>),0,0),str(inside(O,<0,0,0>),0,0),"\n") #end
In("pl",plane{y,0.12}) In("pl1",plane{y,1}) In("b",box{0,1}) In("b2",box{-1,0}) In("s",sphere{0,1}) In("c",cylinder{0,y,1}) In("c2",cylinder{-y,0,1}) In("co",cone{0,1,y,0}) In("q",quadric{<0,1,0>,0,0,0})In("d",disc{0,y,1}) In("d",disc{y,y,1})

#declare OM = mesh2 { vertex_vectors { 6, x,y,z,-x,-y,-z } face_indices { 8, <0,1,2>,<1,3,2>,<3,4,2>,<4,0,2>,<1,0,5>,<3,1,5>,<4,3,5>,<0,4,5> } inside_vector z }
In("om",OM) All(OM,"om") All(intersection{object{OM}box{-1,0.2}},"omi")
