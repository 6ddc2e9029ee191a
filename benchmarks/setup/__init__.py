"""What a trial is set up from: a scenario and its parts, an agent, and the names they go by."""
