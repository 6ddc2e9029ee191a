"""Names of localizers: built in, registered, installed, or said by where their code is."""
