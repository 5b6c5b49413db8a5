"""The paper's two studies, its tables and figures: `python -m benchmarks.paper`.

published   what the paper prints
studies     the plants, the models fitted to them, what is measured of each
tables      the paper's tables with ours, and what must be reached
figures     output and errors against time
report      tables as text, CSV, Markdown and reStructuredText
"""
