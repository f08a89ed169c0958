// Run by node behind the page's scripts: opens the bundle that its argument names.
openBundle(new Uint8Array(require('fs').readFileSync(process.argv[2])));
