//! The few functions of Open Image Denoise's C interface that are needed, loaded at run time.
//!
//! Declared by hand from the public documentation (<https://www.openimagedenoise.org/documentation.html>). Versions
//! 1.4 and 2.x differ only in the names of the functions that set and get typed parameters. Everything unsafe of the
//! denoiser is in this file.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::{self, NonNull};

use libloading::Library;

/// `OIDN_DEVICE_TYPE_CPU`.
const DEVICE_CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FORMAT_FLOAT3: c_int = 3;
/// `OIDN_ERROR_NONE`.
const NO_ERROR: c_int = 0;

type Handle = *mut c_void;
type SetImage = unsafe extern "C" fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);

/// The functions of a loaded library. They stay valid until the process ends: the library is never unloaded.
#[derive(Clone, Copy)]
pub(super) struct Api {
    new_device: unsafe extern "C" fn(c_int) -> Handle,
    set_device_int: unsafe extern "C" fn(Handle, *const c_char, c_int),
    set_device_bool: unsafe extern "C" fn(Handle, *const c_char, bool),
    get_device_int: unsafe extern "C" fn(Handle, *const c_char) -> c_int,
    commit_device: unsafe extern "C" fn(Handle),
    device_error: unsafe extern "C" fn(Handle, *mut *const c_char) -> c_int,
    release_device: unsafe extern "C" fn(Handle),
    new_filter: unsafe extern "C" fn(Handle, *const c_char) -> Handle,
    set_shared_image: SetImage,
    set_filter_bool: unsafe extern "C" fn(Handle, *const c_char, bool),
    commit_filter: unsafe extern "C" fn(Handle),
    execute_filter: unsafe extern "C" fn(Handle),
    release_filter: unsafe extern "C" fn(Handle),
}

impl Api {
    /// Loads a library from a file, or by a bare name from the places that the system's loader searches.
    pub fn load(file: &Path) -> Result<Self, String> {
        let library = open(file)?;
        let api = Self::find(&library)?;
        // Threads of the library's pool may outlive every handle; unloading would take the code from under them.
        std::mem::forget(library);
        Ok(api)
    }

    fn find(library: &Library) -> Result<Self, String> {
        // SAFETY: the types are those of the documented C functions of these names, in 1.4 and in 2.x; the pointers do
        // not outlive the library, which `load` keeps forever.
        unsafe {
            Ok(Self {
                new_device: symbol(library, &["oidnNewDevice"])?,
                set_device_int: symbol(library, &["oidnSetDeviceInt", "oidnSetDevice1i"])?,
                set_device_bool: symbol(library, &["oidnSetDeviceBool", "oidnSetDevice1b"])?,
                get_device_int: symbol(library, &["oidnGetDeviceInt", "oidnGetDevice1i"])?,
                commit_device: symbol(library, &["oidnCommitDevice"])?,
                device_error: symbol(library, &["oidnGetDeviceError"])?,
                release_device: symbol(library, &["oidnReleaseDevice"])?,
                new_filter: symbol(library, &["oidnNewFilter"])?,
                set_shared_image: symbol(library, &["oidnSetSharedFilterImage"])?,
                set_filter_bool: symbol(library, &["oidnSetFilterBool", "oidnSetFilter1b"])?,
                commit_filter: symbol(library, &["oidnCommitFilter"])?,
                execute_filter: symbol(library, &["oidnExecuteFilter"])?,
                release_filter: symbol(library, &["oidnReleaseFilter"])?,
            })
        }
    }

    /// A device on the CPU with so many threads; 0 leaves the number to the library.
    pub fn device(&self, threads: usize) -> Result<Device<'_>, String> {
        // SAFETY: a plain call; a null handle says that it failed.
        let raw = NonNull::new(unsafe { (self.new_device)(DEVICE_CPU) });
        let Some(raw) = raw else {
            // SAFETY: the documentation allows a null device here, to ask why creation failed.
            return Err(unsafe { self.error(ptr::null_mut()) }.unwrap_or_else(|| "no device for this CPU".into()));
        };
        let device = Device { api: self, raw };
        // SAFETY: `raw` is a live device, the names are documented parameters and end with a zero byte.
        unsafe {
            if threads > 0 {
                (self.set_device_int)(raw.as_ptr(), c"numThreads".as_ptr(), c_int::try_from(threads).unwrap_or(c_int::MAX));
                // Pinning is for the one program of a machine; several with few threads would share the first cores.
                (self.set_device_bool)(raw.as_ptr(), c"setAffinity".as_ptr(), false);
            }
            (self.commit_device)(raw.as_ptr());
        }
        device.check()?;
        Ok(device)
    }

    /// The first error since the last question.
    ///
    /// # Safety
    /// `device` is a live device or null.
    unsafe fn error(&self, device: Handle) -> Option<String> {
        let mut message: *const c_char = ptr::null();
        // SAFETY: of the device as the caller promises; `message` is a place for one pointer.
        let code = unsafe { (self.device_error)(device, &mut message) };
        if code == NO_ERROR {
            return None;
        }
        if message.is_null() {
            return Some(format!("error {code}"));
        }
        // SAFETY: not null, so a C string that lives until the next call of the library on this thread.
        Some(unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned())
    }
}

/// Opens a library. Neighbors that it needs are taken from its own folder, which the PyPI package `oidn` does not arrange.
fn open(file: &Path) -> Result<Library, String> {
    let library = open_file(file);
    let folder = file.parent().filter(|f| f.is_absolute());
    let (Err(_), Some(entries)) = (&library, folder.and_then(|f| std::fs::read_dir(f).ok())) else {
        return library.map_err(|e| e.to_string());
    };
    let is_neighbor = |path: &Path| path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with("libtbb.so."));
    let neighbors: Vec<Library> =
        entries.flatten().map(|e| e.path()).filter(|p| is_neighbor(p)).filter_map(|p| open_file(&p).ok()).collect();
    let library = if neighbors.is_empty() { library } else { open_file(file) };
    neighbors.into_iter().for_each(std::mem::forget);
    library.map_err(|e| e.to_string())
}

#[cfg(not(windows))]
fn open_file(file: &Path) -> Result<Library, libloading::Error> {
    // SAFETY: runs the initializers of a library that the user installed under this name, as linking to it would.
    unsafe { Library::new(file) }
}

#[cfg(windows)]
fn open_file(file: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::windows::{LOAD_WITH_ALTERED_SEARCH_PATH, Library as WindowsLibrary};
    // The flag makes the loader look for the other parts beside the library; it asks for an absolute path.
    let flags = if file.is_absolute() { LOAD_WITH_ALTERED_SEARCH_PATH } else { 0 };
    // SAFETY: runs the initializers of a library that the user installed under this name, as linking to it would.
    unsafe { WindowsLibrary::load_with_flags(file, flags) }.map(Library::from)
}

/// The function of the first of these names that is there.
///
/// # Safety
/// `T` is the type of a pointer to that function, and the copy is not used after the library is unloaded.
unsafe fn symbol<T: Copy>(library: &Library, names: &[&str]) -> Result<T, String> {
    for name in names {
        // SAFETY: as the caller promises.
        if let Ok(found) = unsafe { library.get::<T>(name.as_bytes()) } {
            return Ok(*found);
        }
    }
    Err(format!("it has no function {}", names.join(" or ")))
}

/// A device; not for other threads, because errors are kept per thread.
pub(super) struct Device<'a> {
    api: &'a Api,
    raw: NonNull<c_void>,
}

impl Device<'_> {
    /// major · 10000 + minor · 100 + patch.
    pub fn version(&self) -> u32 {
        // SAFETY: a live device and a documented parameter.
        let version = unsafe { (self.api.get_device_int)(self.raw.as_ptr(), c"version".as_ptr()) };
        u32::try_from(version).unwrap_or(0)
    }

    fn check(&self) -> Result<(), String> {
        // SAFETY: a live device.
        unsafe { self.api.error(self.raw.as_ptr()) }.map_or(Ok(()), Err)
    }

    /// Runs the filter `RT`: named interleaved inputs of width × height × 3 values and named switches, to `output`.
    pub fn run(&self, size: [usize; 2], inputs: &[(&CStr, &[f32])], switches: &[&CStr], output: &mut [f32]) -> Result<(), String> {
        let values = size[0].checked_mul(size[1]).and_then(|n| n.checked_mul(3));
        if inputs.iter().map(|(_, data)| data.len()).chain([output.len()]).any(|n| Some(n) != values) {
            return Err("an image is not of the stated size".into());
        }
        // SAFETY: a live device and a documented filter.
        let raw = NonNull::new(unsafe { (self.api.new_filter)(self.raw.as_ptr(), c"RT".as_ptr()) });
        let Some(raw) = raw else {
            self.check()?;
            return Err("no filter".into());
        };
        let filter = Filter { api: self.api, raw };
        let set = |name: &CStr, data: *mut f32| {
            // SAFETY: a live filter; `data` holds width × height pixels of three floats without gaps, as checked above,
            // and outlives the filter's execution below. Zero strides mean "no gaps".
            unsafe { (self.api.set_shared_image)(raw.as_ptr(), name.as_ptr(), data.cast(), FORMAT_FLOAT3, size[0], size[1], 0, 0, 0) };
        };
        for (name, data) in inputs {
            // The library only reads its inputs; the C type has no const.
            set(name, data.as_ptr().cast_mut());
        }
        set(c"output", output.as_mut_ptr());
        // SAFETY: a live filter, whose images are alive; execution is synchronous.
        unsafe {
            for switch in switches {
                (self.api.set_filter_bool)(raw.as_ptr(), switch.as_ptr(), true);
            }
            (self.api.commit_filter)(raw.as_ptr());
            (self.api.execute_filter)(raw.as_ptr());
        }
        drop(filter);
        self.check()
    }
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: this is the only reference, made by `Api::device`.
        unsafe { (self.api.release_device)(self.raw.as_ptr()) };
    }
}

struct Filter<'a> {
    api: &'a Api,
    raw: NonNull<c_void>,
}

impl Drop for Filter<'_> {
    fn drop(&mut self) {
        // SAFETY: this is the only reference, made by `Device::run`.
        unsafe { (self.api.release_filter)(self.raw.as_ptr()) };
    }
}
