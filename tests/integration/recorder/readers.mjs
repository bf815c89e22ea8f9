// Reads MCAP files with the reader for JavaScript that Foxglove uses; prints one object for each file.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
const require = createRequire(process.argv[2] + "/");
const { McapStreamReader, McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");

const decompressHandlers = { zstd: (buffer) => decompress(new Uint8Array(buffer)) };

for (const name of process.argv.slice(3)) {
  const data = readFileSync(name);
  const reader = new McapStreamReader({ decompressHandlers });
  reader.append(data);
  let messages = 0;
  const topics = new Set();
  const encodings = new Set();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Message") messages++;
    if (record.type === "Channel") {
      topics.add(record.topic);
      encodings.add(record.messageEncoding);
    }
  }
  let indexed = null;
  if (name.endsWith("export.mcap")) {
    const readable = {
      size: async () => BigInt(data.length),
      read: async (offset, length) => new Uint8Array(data.subarray(Number(offset), Number(offset + length))),
    };
    indexed = 0;
    const found = await McapIndexedReader.Initialize({ readable, decompressHandlers });
    for await (const message of found.readMessages()) {
      JSON.parse(new TextDecoder().decode(message.data));
      indexed++;
    }
  }
  const done = reader.done();
  console.log(JSON.stringify({ messages, indexed, done, topics: topics.size, encodings: [...encodings] }));
}
