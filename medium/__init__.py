"""The radio that the robots share: who hears whom, and how loud."""
