#version 3.7;
global_settings { assumed_gamma 1 max_trace_level 5 }
#declare A = array[2][2] {{1, 2}, {3, 4}}
#declare V = <1, 2, 3>*2 - x + vrotate(y, 30*z);
#declare S = concat("a", str(V.x, 0, 3), chr(65), substr("abc", 2, 1));
#declare F = function(a, b) { a*b + sin(a) }
#declare P = spline { cubic_spline 0, <0,0,0> 1, <1,0,0> 2, <0,1,0> 3, <1,1,1> }
#macro M(N, T) #if (N > 0) object { T translate N*x } M(N - 1, T) #end #end
#declare R = seed(7);
#local Ball = sphere { 0, rand(R) }
union { M(2, Ball) }
#for (I, 0, 3, 2) #debug str(I + F(1, 2), 0, 2) #end
#while (A[1][0] < 4) #declare A[1][0] = A[1][0] + 1; #end
#switch (A[0][1]) #case (1) #debug "1" #break #range (2, 3) #debug S #break #else #debug "e" #end
#ifdef (V) #undef V #else #error "no" #end
#fopen H "t" write #write (H, 1, ",", <1,2,3>, "\n") #fclose H
#fopen H "t" read #read (H, X, Y) #ifdef (H) #fclose H #end
#default { pigment { rgb 1 } finish { ambient 0 } }
#declare C = color red 1 green 0.5 filter 0.1;
camera { location <0, 1, P(1.5).z - 5> look_at 0 angle (1 ? 50 : 60) right x*image_width/image_height }
light_source { <5, 5, -5> C }
