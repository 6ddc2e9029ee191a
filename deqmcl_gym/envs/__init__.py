"""The Gymnasium environments and their wrappers."""
