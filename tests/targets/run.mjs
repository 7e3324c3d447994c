// Runs scenarios in the WebAssembly engine: node run.mjs ENGINE.wasm SCENARIO... Prints the line of run-hash for each.
import { readFileSync } from "node:fs";
import { basename } from "node:path";

const [module, ...files] = process.argv.slice(2);
const wasm = new WebAssembly.Module(readFileSync(module));

for (const file of files) {
  const { exports } = new WebAssembly.Instance(wasm, {});
  const ask = (question) => {
    const bytes = new TextEncoder().encode(JSON.stringify(question));
    // The call comes first: memory that grows gets a new buffer.
    const at = exports.allocate_request(bytes.length);
    new Uint8Array(exports.memory.buffer, at).set(bytes);
    const answered = exports.process_request();
    const answer = exports.response();
    return JSON.parse(new TextDecoder().decode(new Uint8Array(exports.memory.buffer, answer, answered)));
  };
  const text = readFileSync(file, "utf8");
  let said = ask({ do: "open", file, text, faults: [] });
  if (!said.error) said = ask({ do: "advance", ticks: 1e9, told: 0 });
  if (!said.error) said = ask({ do: "left" });
  if (said.error) {
    console.error(said.error);
    process.exit(1);
  }
  console.log(`${basename(file, ".toml")} ${said.digest}`);
}
