"""Content of the page as one file."""

import io
import zipfile
from collections.abc import Mapping

from matplotlib.figure import Figure

from ..._branches.branch import Branch
from .motion import PointMotion


def archive_of(
    motion: PointMotion | None, pictures: Mapping[str, Figure], code: str, words: str, branches: list[Branch]
) -> io.BytesIO:
    """A zip file: pictures (.pdf, .svg), events (.csv), branches (.csv), the words of the page and its code."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as whole:
        whole.writestr("shown.txt", words)
        whole.writestr("shown.py", code)
        for name, figure in pictures.items():
            for suffix in ("pdf", "svg"):
                drawn = io.BytesIO()
                figure.savefig(drawn, format=suffix)
                whole.writestr(f"{name.replace(' ', '_')}.{suffix}", drawn.getvalue())
        if motion is not None:
            whole.writestr("events.csv", motion.solution.events.to_dataframe().to_csv(index=False))
        for k, branch in enumerate(branches):
            scalars = [name for name, one in branch.points.variables.items() if one.dims == ("point",)]
            whole.writestr(f"branch{k}.csv", branch.points[scalars].to_dataframe().to_csv(index=False))
    archive.seek(0)
    return archive
