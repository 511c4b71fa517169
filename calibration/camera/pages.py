"""A page to print, in millimetres: black rectangles, grey lines and text, as PDF or as pixels.

Written without a library so that nothing in the file can change the print's scale: no embedded
picture that a viewer may resample, no crop box that it may fit to the paper.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rig.files import write_ours, write_whole

MM_PER_POINT = 25.4 / 72
MADE = b"%made by balancing-table-rig\n"  # a comment in PDF
PAPERS_MM = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}


@dataclass
class Page:
    """One page to print; all lengths in mm from its top left corner, y down: `rectangles` (x, y,
    width, height) black, `lines` (x1, y1, x2, y2) grey, `texts` (x, y of the base line's left end,
    height, text)."""

    width_mm: float
    height_mm: float
    rectangles: list[tuple[float, float, float, float]] = field(default_factory=list)
    lines: list[tuple[float, float, float, float]] = field(default_factory=list)
    texts: list[tuple[float, float, float, str]] = field(default_factory=list)

    def pattern(self, black: np.ndarray, x_mm: float, y_mm: float, cell_mm: float) -> None:
        """Add the true cells of `black` (rows, columns), bool, as squares of `cell_mm` with the
        pattern's top left corner at (`x_mm`, `y_mm`).

        Neighbouring cells are merged into one rectangle, along a row first and then over equal rows
        below, so that no white hairline appears between them.
        """
        rows, columns = black.shape
        todo = black.copy()
        for row in range(rows):
            column = 0
            while column < columns:
                if not todo[row, column]:
                    column += 1
                    continue
                wide = 1
                while column + wide < columns and todo[row, column + wide]:
                    wide += 1
                tall = 1
                while row + tall < rows and todo[row + tall, column : column + wide].all():
                    tall += 1
                todo[row : row + tall, column : column + wide] = False
                place = (x_mm + column * cell_mm, y_mm + row * cell_mm)
                self.rectangles.append((*place, wide * cell_mm, tall * cell_mm))
                column += wide

    def ruler(self, x_mm: float, y_mm: float, length_mm: int = 100) -> None:
        """Add a ruler of `length_mm` from (`x_mm`, `y_mm`) to the right, with a tick per mm, to be
        checked against a real one."""
        for tick in range(length_mm + 1):
            tall = 4.0 if tick % 10 == 0 else 3.0 if tick % 5 == 0 else 2.0
            self.lines.append((x_mm + tick, y_mm, x_mm + tick, y_mm - tall))
        self.lines.append((x_mm, y_mm, x_mm + length_mm, y_mm))
        self.texts.append((x_mm + length_mm + 3, y_mm, 3.0, f"{length_mm} mm: measure this"))

    def pixels(self, dpi: float = 300.0) -> np.ndarray:
        """The rectangles and lines, without the texts, as an image (h, w) uint8 at `dpi`; pixels
        that an edge crosses are grey in proportion."""
        scale = dpi / 25.4
        shape = (round(self.height_mm * scale), round(self.width_mm * scale))
        ink = np.zeros(shape)
        for x, y, w, h in self.rectangles:
            across = _covered(x * scale, (x + w) * scale, shape[1])
            down = _covered(y * scale, (y + h) * scale, shape[0])
            rows, columns = np.flatnonzero(down), np.flatnonzero(across)
            if rows.size and columns.size:
                part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
                ink[part] += np.outer(down[part[0]], across[part[1]])
        grey = np.rint(255 * (1 - np.clip(ink, 0, 1))).astype(np.uint8)
        for x1, y1, x2, y2 in self.lines:
            ends = (np.array([x1, y1, x2, y2]) * scale).astype(int)
            low = np.maximum(np.minimum(ends[:2], ends[2:]), 0)
            high = np.maximum(ends[:2], ends[2:])
            grey[low[1] : high[1] + 1, low[0] : high[0] + 1] = np.minimum(
                grey[low[1] : high[1] + 1, low[0] : high[0] + 1], 110
            )
        return grey


def _covered(start: float, end: float, size: int) -> np.ndarray:
    """How much of each of `size` pixels lies between start and end (size,), 0 to 1."""
    edges = np.arange(size + 1)
    return np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], start), 0, 1)


def write_pdf(pages: list[Page], path: Path) -> None:
    """Write the pages as a PDF of true size. `OSError`: not written; an older one stays, and
    one of somebody else's is kept beside the new one.
    """
    objects: list[bytes] = [b"", b""]  # catalogue and page tree come to know the pages below
    font = b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"
    objects.append(font)
    kids = []
    for page in pages:
        body = _content(page)
        objects.append(b"<< /Length %d >>\nstream\n%s\nendstream" % (len(body), body))
        box = f"[0 0 {page.width_mm / MM_PER_POINT:.4f} {page.height_mm / MM_PER_POINT:.4f}]"
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents {len(objects)} 0 R "
            "/Resources << /Font << /F 3 0 R >> >> >>".encode()
        )
        kids.append(f"{len(objects)} 0 R")
    # PrintScaling None asks the viewer not to fit the page to the printer's margins.
    objects[0] = b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
    objects[1] = f"<< /Type /Pages /Count {len(kids)} /Kids [{' '.join(kids)}] >>".encode()
    write_ours(path, _file(objects), MADE)


def _file(objects: list[bytes]) -> bytes:
    out, places = b"%PDF-1.7\n" + MADE, []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    tail = b"trailer << /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n"
    head = b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    return out + head + table + tail % (len(objects) + 1, len(out))


def _content(page: Page) -> bytes:
    """The page's drawing, in mm from the bottom left by the first line's scale."""
    k, top = 1 / MM_PER_POINT, page.height_mm
    parts = [f"{k:.8f} 0 0 {k:.8f} 0 0 cm"]
    parts += [f"{x:.4f} {top - y - h:.4f} {w:.4f} {h:.4f} re" for x, y, w, h in page.rectangles]
    parts.append("f 0.4 G 0.15 w")
    parts += [
        f"{x1:.4f} {top - y1:.4f} m {x2:.4f} {top - y2:.4f} l S" for x1, y1, x2, y2 in page.lines
    ]
    for x, y, tall, text in page.texts:
        safe = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        parts.append(f"BT /F {tall:.2f} Tf {x:.4f} {top - y:.4f} Td ({safe}) Tj ET")
    return "\n".join(parts).encode("latin-1", "replace")


def write_png(page: Page, path: Path, dpi: float = 300.0) -> None:
    """Write one page as a PNG image at `dpi`. `OSError`: as of `write_pdf`."""
    import cv2

    image, scale = page.pixels(dpi), dpi / 25.4
    for x, y, tall, text in page.texts:
        place, size = (round(x * scale), round(y * scale)), 0.7 * tall * scale / 21
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, (90,), 2, cv2.LINE_AA)
    write_whole(path, cv2.imencode(".png", image)[1].tobytes())
