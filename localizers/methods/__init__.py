"""The methods, one file each: what it believes in the first line, then where it is from."""
