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
    assert_eq!(debug(text).unwrap(), "14 1.0,4.0,6.0 5 6\n120\n0123ABCrange");
}
