"""A radio control: the frames of its receiver, the rule by which its hand takes over, the search for its channels."""
