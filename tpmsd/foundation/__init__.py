"""Foundation: small things without a subject, which every layer may import and which import none.

In and out: plain values. Errors with their exit codes, wheel names and array types, bounds, colours, text and
TOML files, plain copies of records, the JSON schemas, the origin of a document, the version, and what a
command need not import.

To be changed here: little. A thing that knows of tyres, buses or drives belongs to a layer above.
"""
