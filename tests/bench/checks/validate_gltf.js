// Prints what Khronos' validator says of a file as JSON: node validate_gltf.js FOLDER_OF_VALIDATOR FILE
const fs = require("fs");
const [folder, file] = process.argv.slice(2);
require(folder)
  .validateBytes(new Uint8Array(fs.readFileSync(file)))
  .then((report) => console.log(JSON.stringify(report)));
