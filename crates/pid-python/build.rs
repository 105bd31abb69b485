//! On macOS the linker must be told that symbols of Python are found at run time.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
