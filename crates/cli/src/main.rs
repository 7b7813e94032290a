//! The `etendue` command: a thin door to [`etendue_cli::main`].

fn main() -> std::process::ExitCode {
    etendue_cli::main(std::env::args_os())
}
