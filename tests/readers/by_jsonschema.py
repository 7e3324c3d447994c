"""Checks that a schema is valid, and accepts or refuses scenario files: SCHEMA accepts|refuses FILE..."""

import json
import sys
import tomllib

from jsonschema import Draft7Validator

schema_path, verdict, *paths = sys.argv[1:]
with open(schema_path, encoding="utf-8") as file:
    schema = json.load(file)
Draft7Validator.check_schema(schema)
validator = Draft7Validator(schema)
wrong = []
for path in paths:
    with open(path, "rb") as file:
        errors = [error.message for error in validator.iter_errors(tomllib.load(file))]
    if (verdict == "accepts") == bool(errors):
        wrong.append(f"{path}: {errors}")
if wrong or not paths:
    sys.exit("\n".join(wrong) or "no files")
