"""What the tables of results have in common: rows by name, text, data frames."""


class Rows:
    """Find the rows of a table by their names.

    A class says in `_rows` which of its fields they are.
    """

    _rows = "rows"

    def __iter__(self):
        """Yield the rows."""
        return iter(getattr(self, self._rows))

    def __len__(self):
        """Return the number of rows."""
        return len(getattr(self, self._rows))

    def __getitem__(self, name):
        """Return the row of a name."""
        for row in self:
            if row.name == name:
                return row
        names = ", ".join(row.name for row in self)
        raise KeyError(f"`name` must be one of {names}, got {name!r}.")

    def frame(self, data, kind="model"):
        """Return figures of the rows as a pandas DataFrame, indexed by their names.

        Parameters
        ----------
        data : list of dict, or dict of str to list
            Figures by name of every row, or of all rows by name.
        kind : str, default="model"
            What a row is.

        Returns
        -------
        frame : pandas.DataFrame
            The table.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return data_frame(data, [row.name for row in self], kind)


def aligned(cells):
    """Return a table as lines of text.

    Parameters
    ----------
    cells : sequence of sequence of str
        Cells, row by row.

    Returns
    -------
    lines : list of str
        Rows, the first column to the left, the others to the right.
    """
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if i else text.ljust(width)
            for i, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    ]


def data_frame(data, index=None, name=None, columns=None):
    """Return a pandas DataFrame.

    Parameters
    ----------
    data : object
        What `pandas.DataFrame` takes.
    index : sequence or None, default=None
        Labels of the rows; None numbers them.
    name : str or None, default=None
        What the labels are.
    columns : list of str or None, default=None
        Names of the columns, if the data have none.

    Returns
    -------
    frame : pandas.DataFrame
        The table.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "`to_frame` needs pandas, which could not be imported. Install it by "
            "pip install pandas, or print the table."
        ) from error
    if index is not None:
        index = pandas.Index(index, name=name)
    return pandas.DataFrame(data, index=index, columns=columns)
