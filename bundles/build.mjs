// Makes kg/serving/server/files/vendor/NAME.min.js of the folder NAME it is run in, and the licences of what is in it.
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { basename } from "node:path";

const VENDOR = new URL("../kg/serving/server/files/vendor/", import.meta.url), NAME = basename(process.cwd());
const { build } = createRequire(`${process.cwd()}/`)("esbuild");
const { dependencies } = JSON.parse(readFileSync("package.json", "utf8"));
const versions = Object.entries(dependencies).map(([name, version]) => `${name} ${version}`);

await build({
  entryPoints: [`${NAME}.mjs`],
  outfile: new URL(`${NAME}.min.js`, VENDOR).pathname,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "none",
  banner: { js: `/* ${versions.join(", ")}; licences in ${NAME}.LICENSES */` },
});

const licences = Object.entries(dependencies).map(([name, version]) => {
  const folder = `node_modules/${name}/`, file = readdirSync(folder).find((one) => one.startsWith("LICENSE"));
  return `${name} ${version}\n\n${readFileSync(folder + file, "utf8").trim()}\n`;
});
writeFileSync(new URL(`${NAME}.LICENSES`, VENDOR), licences.join(`\n${"-".repeat(80)}\n\n`));
