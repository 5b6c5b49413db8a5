"""What is known of a fitted model, on one HTML page that needs no network.

`_page` writes HTML and escapes every name, `_sections` says what is in the sections
about the model and the record, `_control` in those about the loop, `_write` puts them
together.  Figures are the displays of `plotting`, as PNG inside the page; where scripts
run, `figures.js` draws the curves of some again, to zoom into and to read.  It is our
own because libraries that do so are larger than all the rest of a page.  A part that
cannot be computed gives its reason instead.
"""

from ._sections import model_steps
from ._summary import Summary, summarize
from ._write import write_report

__all__ = ["Summary", "model_steps", "summarize", "write_report"]
