// Makes kg/server/files/vendor/codemirror.min.js and the licences of what is in it.
import { build } from "esbuild";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";

const VENDOR = new URL("../../kg/server/files/vendor/", import.meta.url);
const { dependencies } = JSON.parse(readFileSync("package.json", "utf8"));
const versions = Object.entries(dependencies).map(([name, version]) => `${name} ${version}`);

await build({
  entryPoints: ["codemirror.mjs"],
  outfile: new URL("codemirror.min.js", VENDOR).pathname,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "none",
  banner: { js: `/* ${versions.join(", ")}; licences in codemirror.LICENSES */` },
});

const licences = Object.entries(dependencies).map(([name, version]) => {
  const folder = `node_modules/${name}/`, file = readdirSync(folder).find((one) => one.startsWith("LICENSE"));
  return `${name} ${version}\n\n${readFileSync(folder + file, "utf8").trim()}\n`;
});
writeFileSync(new URL("codemirror.LICENSES", VENDOR), licences.join(`\n${"-".repeat(80)}\n\n`));
