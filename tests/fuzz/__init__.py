"""Random input against the command line: every case ends with an answer or with a message, never with a defect."""
