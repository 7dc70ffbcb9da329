"""Fleets: many drives of many cars, worked off by Dask, kept as files, asked with DuckDB, judged together.

In: drive folders. Out: a store (one result file per drive, tables in Parquet), and what the drives of a
car and the cars of a model show together. The extra is `tpmsd[fleet]`.
"""
