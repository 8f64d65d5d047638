"""What the paper leaves open, as numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Reading = Literal["laplacian", "binary"]


@dataclass(frozen=True, slots=True)
class PaperParameters:
    """Choices of the paper's method. Lengths of the image are pixels, areas are shares of the image.

    ``reading``: "laplacian" outlines the grey excess-green image, "binary" outlines excess green after a threshold and
    a median filter. ``green_weight``: 2.5 as eq. 1 prints, 2 as the text says. ``neighbours``: 4 or 8, eq. 2.
    ``edge_threshold`` on the absolute Laplacian of the grey image; ``binary_threshold`` and ``median_px`` belong to the
    reading "binary". ``horizontal_skip`` and ``vertical_skip`` are M and N of section 3.3.3 in radii of a disc of the
    region's area. ``centre_sigma_px`` and ``radius_sigma_px`` are the one-sigma errors of a circle, for covariances.
    ``measured_outline`` is the least share of the outline, in both views, of a fruit whose size counts as measured.
    """

    reading: Reading = "binary"
    green_weight: float = 2.5
    neighbours: Literal[4, 8] = 8
    edge_threshold: int = 30
    binary_threshold: int = 2
    median_px: int = 3
    min_area: float = 0.001
    max_area: float = 0.2
    min_circularity: float = 0.6
    horizontal_skip: float = 0.7
    vertical_skip: float = 1.0
    retries: int = 10
    row_tolerance_px: float = 3.0
    min_distance_m: float = 0.2
    max_distance_m: float = 1.5
    centre_sigma_px: float = 2.0
    radius_sigma_px: float = 2.0
    measured_outline: float = 0.7

    def __post_init__(self) -> None:
        if self.reading not in ("laplacian", "binary"):
            raise ValueError(f"reading must be 'laplacian' or 'binary', found {self.reading!r}")
        if not 2.0 <= self.green_weight <= 3.0:
            raise ValueError(f"green_weight must be 2..3 (the paper has 2 and 2.5), found {self.green_weight}")
        if self.neighbours not in (4, 8):
            raise ValueError(f"neighbours must be 4 or 8, found {self.neighbours}")
        if self.median_px not in (1, 3, 5):
            raise ValueError(f"median_px must be 1 (none), 3 or 5, found {self.median_px}")
        if not 0.0 < self.min_area < self.max_area <= 1.0:
            raise ValueError(f"need 0 < min_area < max_area <= 1, found {self.min_area} and {self.max_area}")
        if not 0.0 < self.min_circularity <= 1.0:
            raise ValueError(f"min_circularity must be in (0, 1], found {self.min_circularity}")
        if not (0.0 < self.horizontal_skip <= 1.0 and 0.0 < self.vertical_skip <= 1.5):
            raise ValueError("horizontal_skip must be in (0, 1] and vertical_skip in (0, 1.5], in radii")
        if not 0.0 <= self.measured_outline <= 1.0:
            raise ValueError(f"measured_outline must be 0..1, found {self.measured_outline}")
        if self.retries < 0:
            raise ValueError(f"retries must not be negative, found {self.retries}")
        if not 0.0 < self.min_distance_m < self.max_distance_m:
            raise ValueError("need 0 < min_distance_m < max_distance_m")
        if min(self.row_tolerance_px, self.centre_sigma_px, self.radius_sigma_px) <= 0.0:
            raise ValueError("row_tolerance_px, centre_sigma_px and radius_sigma_px must be above 0")
