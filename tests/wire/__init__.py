"""The wire: golden vectors of every encoding (tests/vectors), and the tables of docs/wire.md."""
