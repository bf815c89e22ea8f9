// The search of the site, as its search page runs it: node search.js SITE WORDS; prints the pages, best first.
const fs = require("fs"), path = require("path"), vm = require("vm");
const [site, words] = process.argv.slice(2);
const ignored = () => undefined;
const page = {
  document: { documentElement: { dataset: {} }, addEventListener: ignored, getElementById: () => null, readyState: "loading" },
  location: { search: "" }, localStorage: { getItem: () => null, setItem: ignored }, addEventListener: ignored, URLSearchParams,
};
page.window = page;
vm.createContext(page);
const html = fs.readFileSync(path.join(site, "search.html"), "utf8");
const scripts = [...html.matchAll(/<script[^>]* src="([^"?]+)/g)].map((found) => found[1]);
for (const name of scripts.filter((name) => !name.includes("furo")))
  vm.runInContext(fs.readFileSync(path.join(site, name), "utf8"), page, { filename: name });
page.words = words;
const found = vm.runInContext("Search._performSearch(...Search._parseQuery(words))", page);
console.log(JSON.stringify(found.reverse().map((one) => one[0])));
