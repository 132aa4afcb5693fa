//! Shared libraries, as the system loads them. A browser loads none: there this package's own is linked, and its functions are
//! found by their names all the same.

#[cfg(not(target_family = "wasm"))]
pub use libloading::Library;
#[cfg(target_family = "wasm")]
pub use linked::Library;

#[cfg(target_family = "wasm")]
mod linked {
    use std::fmt;
    use std::mem::{size_of, transmute_copy};
    use std::path::Path;

    use adaptive_fmu_library::fmi2_functions as own;

    /// A function, before it has its type.
    type Symbol = unsafe extern "C" fn();

    /// This package's library.
    #[derive(Debug)]
    pub struct Library;

    /// Message about a missing function or library.
    #[derive(Debug)]
    pub struct Missing(String);

    impl fmt::Display for Missing {
        fn fmt(&self, text: &mut fmt::Formatter) -> fmt::Result {
            text.write_str(&self.0)
        }
    }

    impl std::error::Error for Missing {}

    impl Library {
        /// Nothing is loaded here.
        ///
        /// # Safety
        /// There is nothing to be aware of: it has the form of what loads a library.
        pub unsafe fn new(path: impl AsRef<Path>) -> Result<Self, Missing> {
            Err(Missing(format!("{}: a browser loads no library", path.as_ref().display())))
        }

        /// A function by its name.
        ///
        /// # Safety
        /// `T` must be the type of the function's pointer.
        pub unsafe fn get<T: Copy>(&self, name: impl AsRef<[u8]>) -> Result<Box<T>, Missing> {
            let name = String::from_utf8_lossy(name.as_ref()).into_owned();
            let found = FUNCTIONS.iter().find(|(known, _)| *known == name);
            let (_, Pointer(symbol)) = found.ok_or_else(|| Missing(format!("there is no function {name}")))?;
            assert_eq!(size_of::<T>(), size_of::<Symbol>(), "{name} is a function");
            // SAFETY: both are pointers to functions; that it is one of this type, the caller states.
            Ok(Box::new(unsafe { transmute_copy(symbol) }))
        }
    }

    struct Pointer(*const ());
    // SAFETY: the address of a function, which never changes.
    unsafe impl Sync for Pointer {}

    macro_rules! functions {
        ($($name:ident),+ $(,)?) => { &[$((stringify!($name), Pointer(own::$name as *const ()))),+] };
    }

    /// Those that loops call for co-simulation.
    static FUNCTIONS: &[(&str, Pointer)] = functions![
        fmi2Instantiate,
        fmi2FreeInstance,
        fmi2SetupExperiment,
        fmi2EnterInitializationMode,
        fmi2ExitInitializationMode,
        fmi2Terminate,
        fmi2Reset,
        fmi2GetReal,
        fmi2GetInteger,
        fmi2GetBoolean,
        fmi2SetReal,
        fmi2SetInteger,
        fmi2SetBoolean,
        fmi2SetString,
        fmi2DoStep,
        fmi2GetDirectionalDerivative,
        adaptive_fmu_do_steps,
    ];
}
