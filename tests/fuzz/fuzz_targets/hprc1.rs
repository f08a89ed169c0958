#![no_main]

reader_fuzz::fuzz!(hprc1);
