#![no_main]

reader_fuzz::fuzz!(radiance);
