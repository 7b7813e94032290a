"""Write crates/procedural/src/power_tables.rs: the constants of `fns::pow`, from 60-digit arithmetic.

python bench/power_tables.py > crates/procedural/src/power_tables.rs
"""

from decimal import Decimal, getcontext

getcontext().prec = 60
LN2 = Decimal(2).ln()
# Mantissas from 1 + HALVED/128 on are halved, so that they lie in [0.7, 1.4).
HALVED = 52


def cut(value: Decimal, bits: int) -> float:
    """Round to a multiple of 2^-bits, which a float holds."""
    return float((value * 2**bits).to_integral_value() / 2**bits)


def parts(value: Decimal, bits: int) -> tuple[float, float]:
    """Return a multiple of 2^-bits and the rest."""
    high = cut(value, bits)
    return high, float(value - Decimal(high))


def main() -> None:
    """Print the file."""
    logs = []
    for i in range(128):
        low = Decimal(1) + Decimal(i) / 128
        center = low + Decimal(1) / 256
        if i >= HALVED:
            center /= 2
        # Nine bits: exact products with 32-bit halves; 1 itself where the center is nearest to 1, so that pow(1 + tiny, y) stays exact.
        inverse = Decimal(cut(1 / center, 9))
        if i in (0, 127):
            inverse = Decimal(1)
        high, rest = parts(-inverse.ln(), 42)
        logs.append((float(inverse), high, rest))
    exps = []
    for j in range(128):
        value = (LN2 * j / 128).exp()
        high = float(value)
        exps.append((high, float((value - Decimal(high)) / value)))
    print("//! Constants of [`crate::fns::pow`]. Made by bench/power_tables.py; do not edit.\n")
    print("/// ln 2 as a multiple of 2⁻⁴², and the rest.")
    print("pub(crate) const LN2: [f64; 2] = [{!r}, {!r}];".format(*parts(LN2, 42)))
    print("/// ln 2 / 128 as a multiple of 2⁻⁴³, and the rest.")
    print("pub(crate) const STEP: [f64; 2] = [{!r}, {!r}];".format(*parts(LN2 / 128, 43)))
    print("/// 128 / ln 2.")
    print(f"pub(crate) const STEPS: f64 = {float(128 / LN2)!r};")
    print(
        "/// For each 128th of a mantissa: about its inverse, with nine bits after the point; minus the logarithm of that, as a multiple of"
    )
    print("/// 2⁻⁴², and the rest.")
    print("#[rustfmt::skip]\npub(crate) const LOG: [[f64; 3]; 128] = [")
    for row in logs:
        print("    [{!r}, {!r}, {!r}],".format(*row))
    print("];\n/// 2^(j/128), and its relative error.")
    print("#[rustfmt::skip]\npub(crate) const EXP: [[f64; 2]; 128] = [")
    for row in exps:
        print("    [{!r}, {!r}],".format(*row))
    print("];")


if __name__ == "__main__":
    main()
