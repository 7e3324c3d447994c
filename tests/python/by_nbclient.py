"""Executes a notebook in the current folder: ``by_nbclient.py NOTEBOOK``; prints the outputs of its cells."""

import sys

import nbclient
import nbformat

notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
for cell in notebook.cells:
    for output in cell.get("outputs", []):
        data = output.get("data", {"text/plain": output.get("text", "")})
        print(" ".join(sorted(data)))
        print(data["text/plain"])
