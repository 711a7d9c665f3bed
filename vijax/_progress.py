"""The progress bar: a widget in notebooks that can show one, else a line of text."""

import warnings

from tqdm import TqdmWarning

with warnings.catch_warnings():
    # A notebook without ipywidgets gets the line of text; nobody has to be warned at every import.
    warnings.simplefilter("ignore", TqdmWarning)
    from tqdm.auto import tqdm as tqdm
