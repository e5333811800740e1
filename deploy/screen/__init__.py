"""What a person sees while a run goes on: a table in the terminal, or Rerun's viewer."""
