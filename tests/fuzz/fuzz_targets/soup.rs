#![no_main]

reader_fuzz::fuzz!(soup::soup);
