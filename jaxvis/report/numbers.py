"""Numbers as a reader wants them: three significant digits and a unit that fits."""

MISSING = "–"


def decibels(row: dict) -> str:
    """The PSNR of a row of results.json; infinite where the images are equal."""
    if row.get("psnr_db") is None:
        return "∞" if row.get("rmse") == 0.0 else MISSING
    return f"{row['psnr_db']:.2f}"


def significant(value: float | None, digits: int = 3) -> str:
    """A plain number; powers of ten only where it is very small or large."""
    return MISSING if value is None else f"{value:.{digits}g}"


def seconds(value: float | None) -> str:
    """A duration, from microseconds to minutes."""
    if value is None:
        return MISSING
    if value >= 99.95:
        minutes, rest = divmod(round(value), 60)
        return f"{minutes} min {rest} s"
    for scale, unit in ((1.0, "s"), (1e-3, "ms")):
        if value >= 0.9995 * scale:
            return f"{_three(value / scale)} {unit}"
    return f"{_three(value / 1e-6)} µs" if value else "0 s"


def memory(value: int | None) -> str:
    """Bytes in powers of 1024."""
    return _scaled(value, 1024.0, ("B", "KiB", "MiB", "GiB", "TiB"))


def count(value: int | None) -> str:
    """How many, in powers of 1000."""
    return _scaled(value, 1000.0, ("", "k", "M", "G", "T"))


def _scaled(value: int | None, step: float, units: tuple[str, ...]) -> str:
    if value is None:
        return MISSING
    number, power = float(value), 0
    while number >= 999.5 and power < len(units) - 1:
        number, power = number / step, power + 1
    text = f"{value}" if power == 0 else _three(number)
    return f"{text} {units[power]}".strip()


def _three(number: float) -> str:
    """Three significant digits without an exponent (``number`` is below 1000, or rounds to it)."""
    decimals = 2 if number < 9.995 else 1 if number < 99.95 else 0
    return f"{number:.{decimals}f}"
