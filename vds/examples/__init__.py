"""Examples to run and to copy (docs/writing-a-policy.md); `vds examples` says where they are."""
