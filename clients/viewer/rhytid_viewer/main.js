// Begins: finds out whether a service or a package is behind this page, and shows a face of it.

import { addIntake } from "./app/intake.js";
import { Page } from "./app/page.js";
import { isService, packageReader } from "./app/service.js";
import { Served } from "./app/served.js";

const root = new URL(".", location.href);
const page = new Page();
Object.assign(globalThis, { rhytid: page });

try {
  const told = await isService(root);
  const { asset, camera } = page.readAddress();
  if (told) {
    const served = new Served(page, root, told);
    Object.assign(page, { served });
    await served.begin(asset, camera);
  } else {
    page.withoutService();
    addIntake(page, null);
    const packed = document.documentElement.dataset.packed === "gz";
    await page.show(packageReader(root, packed), camera);
  }
} catch (error) {
  page.failed(error);
}
