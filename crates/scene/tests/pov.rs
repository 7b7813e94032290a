//! The language of POV-Ray scenes.

use std::path::Path;
use std::sync::{Arc, Mutex};

use etendue_scene::ReadError;
use etendue_scene::formats::{ReadOptions, pov};

/// What a scene says by `#debug`.
fn debug(text: &str) -> Result<String, String> {
    let out = Arc::new(Mutex::new(String::new()));
    let sink = out.clone();
    let mut options = ReadOptions::default();
    options.pov.messages = Some(Arc::new(move |_, t: &str| sink.lock().unwrap().push_str(t)));
    match pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &options) {
        Ok(_) => Ok(out.lock().unwrap().clone()),
        Err(ReadError::Invalid { .. }) => Err(pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &options).unwrap_err().to_string()),
        Err(e) => Err(e.to_string()),
    }
}

#[test]
fn semicolons_after_macros_that_are_values() {
    let text = r#"
        #macro Twice(V) #if (1) #local R = array[2] { V, 2*V } #end R #end
        #macro Ball(V) #local A = Twice(V); #local B = Twice(-V); sphere { 0, A[1] } #debug str(A[1] + B[0], 0, 0) #end
        union { Ball(1) Ball(3) }
    "#;
    is(text, "13");
}

#[test]
fn expressions() {
    let text = r#"
        #declare A = 2+3*4;
        #declare V = <1,2,3>*2 - x;
        #debug concat(str(A,0,0), " ", vstr(3,V,",",0,1), " ", str((1<2)&(3>2)?5:6,0,0), " ", str(-2*-3,0,0), "\n")
        #macro F(n) #if (n<=1) 1 #else (n*F(n-1)) #end #end
        #debug concat(str(F(5),0,0), "\n")
        #for (I,0,3) #debug str(I,0,0) #end
        #declare N = 0; #while (N < 3) #debug chr(65+N) #declare N = N+1; #end
        #switch (2) #case (1) #debug "one" #break #range (2,3) #debug "range" #break #else #debug "else" #end
    "#;
    is(text, "14 1.0,4.0,6.0 5 6\n120\n0123ABCrange");
}

fn is(text: &str, said: &str) {
    assert_eq!(debug(text).unwrap_or_else(|e| panic!("{text}: {e}")), said, "{text}");
}

fn fails(text: &str, message: &str) {
    let error = debug(text).expect_err(text);
    assert!(error.contains(message), "{text}: {error}");
}

/// Values that POV-Ray 3.7.0.10 prints for the same text, unless a comment says otherwise.
#[test]
fn as_measured() {
    for (text, said) in [
        ("#macro M(A,B) #debug concat(str(A,0,0),str(B,0,0)) #end M(1 2)", "12"),
        ("#debug str(version,0,4)", "3.7000"),
        ("#version 3.5; #debug str(version,0,2)", "3.50"),
        ("#declare T=version; #version 3.1; #version T; #debug str(version,0,6)", "3.700000"),
        (
            "#debug concat(str(mod(-5,3),0,5),\" \",str(mod(5,-3),0,5),\" \",str(div(-5,3),0,5),\" \",str(int(-1.5),0,3))",
            "-2.00000 2.00000 -1.00000 -1.000",
        ),
        ("#debug str(pow(-8,3),0,3)", "-512.000"),
        ("#debug str(div(1,0),0,3)", "-2147483648.000"),
        ("#debug str(1/0,0,3)", "inf"),
        ("#debug vstr(3,<1,2,3>/<1,0,1>,\",\",0,2)", "1.00,inf,3.00"),
        ("#debug str(acos(2),0,3)", "0.000"),
        ("#debug vstr(3,<1,2,3,4>,\",\",0,2)", "1.00,2.00,3.00"),
        (
            "#debug concat(\"mix \",vstr(5,<1,2>+<1,2,3,4>,\",\",0,2),\" \",vstr(5,2+<1,2>,\",\",0,2),\" \",vstr(3,2/<1,2,4>,\",\",0,2))",
            "mix 2.00,4.00,3.00,4.00,0.00 3.00,4.00,0.00,0.00,0.00 2.00,1.00,0.50",
        ),
        ("#debug concat(str(strcmp(\"a\",\"c\"),0,2),\" \",str(strcmp(\"abc\",\"ab\"),0,2))", "-2.00 99.00"),
        (
            "#debug concat(str((3&0|1),0,0),str((1|1&0),0,0),str((2=2.00000000001),0,0),str(!3,0,0),str((1<2<3),0,0),str(-2*-3,0,0),str((1 ? 2 : 0 ? 3 : 4),0,0))",
            "1010162",
        ),
        ("#debug concat(str(bitwise_and(7,3.9),0,0),str(bitwise_or(1,2,4),0,0),str(bitwise_xor(-1,1),0,0))", "37-2"),
        (
            "#debug concat(vstr(3,vrotate(<1,2,3>,<10,20,30>),\",\",0,8),\" \",vstr(3,vaxis_rotate(<1,2,3>,<1,1,0>,30),\",\",0,8))",
            "1.06742538,2.28905948,2.76058141 2.12764747,0.87235253,2.95162960",
        ),
        ("#debug concat(str((<1,0,0>).gray,0,6),str((<0,1,0>).gray,0,6),str((<0,0,1>).gray,0,6))", "0.2970000.5890000.114000"),
        (
            "#for(I,0,0.3,0.1) #debug concat(str(I,0,20),\" \") #end",
            "0.00000000000000000000 0.10000000000000000555 0.20000000000000001110 0.30000000000000004441 ",
        ),
        ("#for(I,1,0) #debug \"never\" #end #debug str(I,0,3) #for(I,3,1,-1) #debug str(I,0,0) #end #debug str(I,0,3)", "1.0003210.000"),
        ("#for(I,1,3) #declare I=I+1; #debug str(I,0,0) #end", "24"),
        ("#macro M(A) #local A=7; #end #declare Q=1; M(Q) #debug str(Q,0,0)", "7"),
        ("#macro M(A) #declare A=7; #end #declare Q=array[2]{1,2} M(Q[1]) #debug str(Q[1],0,0)", "7"),
        ("#macro M(A) N(A) #end #macro N(B) #declare B=9; #end #declare Q=1; M(Q) #debug str(Q,0,0)", "9"),
        ("#macro O() #local Q=1; I() #debug str(Q,0,0) #end #macro I() #declare Q=Q+5; #local Q=100; #end O()", "6"),
        ("#macro M() #local Q=1; #declare Q=2; #declare W=3; #end M() #ifdef(Q) #debug \"Q\" #end #debug str(W,0,0)", "3"),
        ("#macro M(A) A+1 #end #debug str(M(5)*2,0,0)", "7"),
        ("#macro M() #break #debug \"no\" #end M() #debug \"yes\"", "yes"),
        ("#while(1) #if(1) #break #end #debug \"no\" #end #debug \"out\"", "out"),
        ("#switch (1) #case (1) #debug \"1\" #case (2) #debug \"2\" #case (1) #debug \"1b\" #else #debug \"else\" #end", "11belse"),
        ("#switch (3) #debug \"stray\" #case (1) #debug \"1\" #break #else #debug \"else\" #end", "strayelse"),
        ("#declare A=array[2]{1,2} #debug str(A[1.9],0,0) #debug str(A[0.99999999999],0,0)", "22"),
        ("#declare A=array[2]{array[2]{1,2},array[2]{3,4}} #debug str(A[1][0],0,0)", "3"),
        ("#declare A=array[2]{1,2} #declare B=A; #declare B[0]=5; #debug str(A[0],0,0)", "1"),
        ("#declare C=color rgb 1 filter 0.5; #debug vstr(5,C,\",\",0,1)", "1.0,1.0,1.0,0.5,0.0"),
        ("#declare C=rgbf 0.5; #debug vstr(5,C,\",\",0,1)", "0.5,0.5,0.5,0.5,0.0"),
        ("#macro M(C) #debug vstr(5,C,\",\",0,1) #end M(rgbt<1,2,3,4>)", "1.0,2.0,3.0,0.0,4.0"),
        (
            "#debug concat(str(5,0,1.9),\" \",str(5,-1.9,1),\" \",str(-5,-8,1),\" \",str(0.5,0,0),str(1.5,0,0),str(2.5,0,0))",
            "5.0 5.0 -00005.0 022",
        ),
        ("#debug concat(datetime(0),\" \",datetime(1.5,\"%d\"))", "2000-01-01 00:00:00Z 02"),
        ("#debug vstr(3,<1 2 3>,\",\",0,0) #debug concat(\"a\" \"b\")", "1,2,3ab"),
        ("#declare T=transform{rotate 30*x translate y} #declare C=transform{T inverse} #declare D=C; #debug \"ok\"", "ok"),
        // A directive without semicolon takes effect before the next one; POV-Ray accepts it up to version 3.1.
        (
            "#version 3.1; #declare A=5 #declare B=A+1 #debug str(B,0,0) #declare N=0 #while(N<3) #declare N=N+1 #end #debug str(N,0,0)",
            "63",
        ),
    ] {
        is(text, said);
    }
}

#[test]
fn files_in_memory() {
    is(
        r##"#fopen F "w.txt" write #write(F,1,",",-0.5,",",1/3,",",1e10,",",<1,2,3>,",","\"s\"") #fclose F
           #fopen F "w.txt" read #while (defined(F)) #read(F,A,B,C,D,V,S) #debug concat(str(A,0,1),str(B,0,1),str(C,0,8),str(D,0,0),vstr(3,V,"",0,0),S) #end"##,
        "1.0-0.50.3333330010000000000123s",
    );
    is(r#"#fopen F "w" write #write(F,"1,2,") #fclose F #fopen F "w" read #while(defined(F)) #read(F,A) #debug str(A,0,0) #end"#, "122");
    is(r##"#fopen F "a.inc" write #write(F,"#declare Q = 5;") #fclose F #include "a.inc" #debug str(Q,0,0)"##, "5");
    fails(r#"#fopen F "../../../../etc/passwd" read"#, "outside");
    fails(r#"#fopen F "/etc/passwd" read"#, "outside");
    fails(r#"#include "/etc/passwd""#, "outside");
}

#[test]
fn writes_only_where_allowed() {
    let folder = std::env::temp_dir().join(format!("etendue-pov-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("in")).unwrap();
    let mut options = ReadOptions::default();
    options.pov.output_folder = Some(folder.join("in"));
    let text =
        r#"#fopen F "a.txt" write #write(F,"x") #fopen G "../b.txt" write #write(G,"x") #fopen H "/tmp/etendue-c.txt" write #write(H,"x")"#;
    let desc = pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &options).unwrap();
    assert_eq!(desc.report.faults.len(), 2);
    assert_eq!(std::fs::read(folder.join("in/a.txt")).unwrap(), b"x");
    assert!(!folder.join("b.txt").exists() && !Path::new("/tmp/etendue-c.txt").exists());
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn errors_have_places() {
    fails("\n  #declare A = B;", "test.pov:2:16: error: the undeclared identifier `B` is not expected in a numeric expression");
    fails(
        "#macro M()\n foo\n#end\n M()",
        "test.pov:2:2: error: the undeclared identifier `foo` is not expected in the scene; in macro M, called at test.pov:4:2",
    );
    fails("#if (1)", "test.pov:1:1: error: this directive has no #end");
    fails("#end", "#end without");
    fails("#declare A = array[2]{1,2}; #debug str(A[2],0,0)", "index 2");
    fails("#declare sphere = 1;", "reserved");
    fails("#error \"stop\"", "#error: stop");
    fails("/* /* */", "comment does not end");
    fails("#debug \"abc", "string does not end");
    fails("#macro M(A,B) #end M(1)", "needs an argument for `B`");
    fails("#declare A = <1,2,3>; sphere { 0, A }", "a float is expected");
}

#[test]
fn odd_bytes() {
    is("\u{feff}#debug \"a\"\r\n#debug \"b\"\r#debug \"c\"", "abc");
    let mut text = b"// caf\xe9\n#debug \"\xe9\"".to_vec();
    assert!(pov::read_bytes(Path::new("t.pov"), &text, &ReadOptions::default()).is_ok());
    text.push(0xff);
    assert!(pov::read_bytes(Path::new("t.pov"), &text, &ReadOptions::default()).is_err());
}

/// Nothing that a scene does may take for ever, fill the memory or overflow the stack.
#[test]
fn hostile() {
    let cases = [
        "#while(1) #end".to_owned(),
        "#for(I,0,1e30) #end".to_owned(),
        "#declare A=0; #while(1) #declare A=A+1; #end".to_owned(),
        "#macro M() M() #end M()".to_owned(),
        "#macro M() #declare X = 1+M(); #end M()".to_owned(),
        "#macro M() M() M() #end M()".to_owned(),
        "#declare S=\"aaaaaaaa\"; #while(1) #declare S=concat(S,S); #end".to_owned(),
        "#declare A=array[1000][1000][1000];".to_owned(),
        "#declare A=array[1000000]; #declare B=array[100]; #for(I,0,99) #declare B[I]=array[1000000]; #end".to_owned(),
        "#declare A=array[1]; #while(1) #declare A[0]=A; #end".to_owned(),
        "#declare R=0; #while(1) #declare R=seed(1); #end".to_owned(),
        format!("#declare A={}1{};", "(".repeat(100_000), ")".repeat(100_000)),
        format!("#declare A={};", "<".repeat(100_000)),
        format!("#declare A={};", "-".repeat(200_000)),
        format!("#declare A={}", "rgb ".repeat(100_000)),
        "union{".repeat(100_000),
        "#if(1) ".repeat(100_000),
        "#fopen F \"a.inc\" write #write(F,\"#include \\\"a.inc\\\"\") #fclose F #include \"a.inc\"".to_owned(),
        "#fopen F \"a\" write #while(1) #write(F,\"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\") #end".to_owned(),
        "#macro M(A) #declare A = transform{A A}; #end #declare T=transform{scale 2}; #while(1) M(T) #end".to_owned(),
        "#declare T=pigment{rgb 1} #while(1) #declare T=pigment{gradient x pigment_map{[0 T][1 T]}} #end".to_owned(),
        "#declare T=sphere{0,1} #while(1) #declare T=union{object{T} sphere{0,1}} #end".to_owned(),
        "#declare T=texture{pigment{rgb 1}} #while(1) #declare T=texture{T} texture{T} #end".to_owned(),
        "#declare A = 1/0; #declare A[A]=1;".to_owned(),
        "#while(1) #warning \"w\" #end".to_owned(),
    ];
    for text in cases {
        let mut options = ReadOptions::default();
        options.pov.work_limit = 2_000_000;
        let start = std::time::Instant::now();
        let result = pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &options);
        let short: String = text.chars().take(60).collect();
        assert!(result.is_err(), "{short}");
        assert!(start.elapsed().as_secs() < 10, "{short}: {:?}", start.elapsed());
    }
}

/// A loop of a million rounds reads eight million tokens in about a second.
#[test]
fn loops_are_quick() {
    let start = std::time::Instant::now();
    is("#declare A=0; #for(I,1,1000000) #declare A=A+I; #end #debug str(A,0,0)", "500000500000");
    assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
}
