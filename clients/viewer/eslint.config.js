import js from "@eslint/js";
import globals from "globals";

export default [
  js.configs.recommended,
  {
    languageOptions: { ecmaVersion: 2022, sourceType: "module", globals: globals.browser },
    rules: {
      eqeqeq: "error",
      "no-var": "error",
      "prefer-const": "error",
      "no-shadow": "error",
      "no-implicit-globals": "error",
      "no-eval": "error",
      "no-unused-vars": [
        "error",
        // Classes that types in comments alone name.
        { argsIgnorePattern: "^_", varsIgnorePattern: "^[A-Z]" },
      ],
    },
  },
];
