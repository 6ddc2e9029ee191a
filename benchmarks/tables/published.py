"""Table 1 of the paper, as printed (Taniguchi, Fukawa & Yamakawa 2024)."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """One row: error and its SD, entropy, and the variances of the four components."""

    title: str
    error: float
    error_sd: float
    entropy: float
    var_x: float
    var_y: float
    var_cos: float
    var_sin: float


TABLE_1 = {
    "deq-mcl": Published("DEQ-MCL", 20.95, 17.66, 7.82, 419.92, 290.04, 0.09, 0.07),
    "mcl-smoother": Published("MCL with smoother", 22.88, 20.01, 8.88, 977.39, 611.06, 0.14, 0.11),
    "mcl-map": Published(
        "MCL with map-based motion model", 25.00, 18.38, 9.69, 792.28, 616.85, 0.17, 0.16
    ),
    "mcl": Published("MCL", 26.17, 22.00, 9.81, 966.93, 591.79, 0.19, 0.16),
}
